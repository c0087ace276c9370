// Long work on a thread of its own, cut into slices of time, so that other work can run in between.
#pragma once

#include <chrono>
#include <functional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/base/clock.h"

namespace candela {

// The length of a slice. What a switch costs does not matter beside it. Work overshoots its slice until its
// next checkpoint, so this is a little less than the 50 ms that it may take.
inline constexpr absl::Duration kSlice = absl::Milliseconds(40);

// Straight code marks the places where it may be paused. If the calling thread runs in slices and its slice
// is over, this blocks until the next slice begins. On any other thread it returns at once. It takes some
// tens of nanoseconds. Call it at least every few milliseconds, where no lock is held, no device work is in
// flight and nothing is half done that other work may see. If the work is cancelled, it throws an exception
// that only SlicedWork catches, so everything that the work holds is released.
void checkpoint();

// The end of the calling thread's slice, for threads that help it: they stop then, and the caller goes
// through checkpoint() before it lets them go on. The greatest time_point on a thread that does not run in
// slices. By the clock of the work, which for such threads has to be the machine's.
std::chrono::steady_clock::time_point slice_end();

// The time for which checkpoint() has paused the calling thread so far.
std::chrono::nanoseconds time_paused();

// Runs a function in slices. It takes one thread, from the first slice to the end of the work. run() and the
// destructor are called by one thread at a time.
class SlicedWork {
 public:
  // Nothing runs yet. `clock` outlives it.
  SlicedWork(std::function<void()> work, Clock& clock);
  // Cancels work that is not finished, and waits until it has released what it holds.
  ~SlicedWork();
  SlicedWork(const SlicedWork&) = delete;
  SlicedWork& operator=(const SlicedWork&) = delete;

  // Lets the work run until it ends, or until its first checkpoint after `length`. Returns true if it ended;
  // then do not call it again. Everything before is visible to the work, and everything it did is visible
  // after.
  bool run(absl::Duration length);

 private:
  enum class State { kPaused, kRunning, kEnded };
  using Moment = std::chrono::steady_clock::time_point;

  friend void checkpoint();
  friend std::chrono::steady_clock::time_point slice_end();
  friend std::chrono::nanoseconds time_paused();

  void main();
  void pause();
  void resume(Moment end) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  std::function<void()> work_;
  Clock& clock_;
  absl::Mutex mutex_;
  State state_ ABSL_GUARDED_BY(mutex_) = State::kPaused;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  // Written between slices; read by the work's own thread.
  Moment end_ = {};
  std::chrono::nanoseconds paused_{0};
  std::thread thread_;  // last, because it uses all of the above
};

}  // namespace candela
