// A few threads that help another thread with a piece of its work.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/synchronization/mutex.h"

namespace candela {

// Use it for short work that its caller waits for. One caller at a time. Idle threads sleep.
class Crew {
 public:
  // `threads` of them with the caller's own; at least 1. Fewer, with a warning, if the system gives no more.
  explicit Crew(uint32_t threads);
  ~Crew();

  uint32_t threads() const { return static_cast<uint32_t>(threads_.size()) + 1; }

  // Calls work(i) for every i below `units`, in ascending order but at the same time. Returns when all calls
  // have returned; what they wrote is visible then. `work` must not throw. If the calling thread runs in
  // slices (slices.h), a slice ends between units, and checkpoint() is called there; so a unit should take a
  // few milliseconds at most.
  void run(uint32_t units, absl::FunctionRef<void(uint32_t unit)> work);

 private:
  struct Job {
    absl::FunctionRef<void(uint32_t)> work;
    uint32_t units;
    std::atomic<uint32_t> next = 0;
    std::chrono::steady_clock::time_point end = std::chrono::steady_clock::time_point::max();  // of the slice
  };

  // Takes units until none is left or the slice ends; at least one.
  static void take_units(Job& job);
  void run_slice(Job& job);
  void serve();

  absl::Mutex mutex_;
  Job* job_ ABSL_GUARDED_BY(mutex_) = nullptr;    // while units may be left
  uint32_t helping_ ABSL_GUARDED_BY(mutex_) = 0;  // threads that have the job
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::vector<std::thread> threads_;  // last, because they use all of the above
};

}  // namespace candela
