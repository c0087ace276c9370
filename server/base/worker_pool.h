// Runs tasks in order of arrival; in the service, on a pool of threads.
#pragma once

#include <deque>
#include <functional>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace candela {

// Any thread may call it. Use it for work that takes long and that no thread waits for.
class WorkerPool {
 public:
  virtual ~WorkerPool() = default;
  // Calls `task` later, never from inside this function.
  virtual void run(std::function<void()> task) = 0;
};

class WorkerThreads final : public WorkerPool {
 public:
  // 0 threads means usable_cpus().
  explicit WorkerThreads(uint32_t threads);
  // Calls stop().
  ~WorkerThreads() override;

  // After stop(), the task is dropped.
  void run(std::function<void()> task) override;

  // Finishes all tasks that it has. Idempotent.
  void stop();

 private:
  void work();

  absl::Mutex mutex_;
  std::deque<std::function<void()>> tasks_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;  // last, because they use all of the above
};

}  // namespace candela
