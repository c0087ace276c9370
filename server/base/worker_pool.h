// Threads for work that takes its time and that nobody waits for.
#pragma once

#include <deque>
#include <functional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace candela {

// Any thread. First come, first served.
class WorkerPool {
 public:
  // `threads` 0: usable_cpus().
  explicit WorkerPool(uint32_t threads);
  // As stop().
  ~WorkerPool();

  // After stop() the task is dropped without a call.
  void run(std::function<void()> task);

  // Finishes what was given to it. Idempotent.
  void stop();

 private:
  void work();

  absl::Mutex mutex_;
  std::deque<std::function<void()>> tasks_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;  // last: they use all of the above
};

}  // namespace candela
