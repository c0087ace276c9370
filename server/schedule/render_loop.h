// The render thread. It takes jobs from the queue and runs them one at a time, long ones in slices.
#pragma once

#include <deque>
#include <functional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/base/clock.h"
#include "server/schedule/frame_queue.h"

namespace candela {

// Any thread may call it. A `done` callback must not call stop(). A job that runs in slices takes a thread of
// its own from its first slice to its end, but only one of all these threads runs at a time, and the render
// thread waits for it.
class RenderLoop {
 public:
  // Runs a job to completion: run_job, or a substitute in tests. Called on the render thread, or on the job's
  // own while the render thread waits.
  using Render = std::function<absl::StatusOr<FrameReport>(const FrameJob&)>;

  // At most `capacity` jobs wait at a time, those between two slices included. Tests shorten and lengthen
  // `slice`. `clock` outlives the loop.
  RenderLoop(Render render, size_t capacity, Clock& clock, absl::Duration slice = kSlice);
  // Calls stop().
  ~RenderLoop();

  // Queues the job. Its `done` is called with the rendered frame, with the renderer's error, or with
  // DEADLINE_EXCEEDED if its turn came too late. UNAVAILABLE if the queue is full or the loop is stopping;
  // then `done` is never called.
  absl::StatusOr<Ticket> submit(FrameJob job);

  // Runs `task` on the render thread ahead of the waiting jobs. Only for the heartbeat: whatever a client
  // asks for is submitted. UNAVAILABLE if the loop is stopping; then the task never runs.
  absl::Status post(std::function<void()> task);

  // Returns true if the job was still waiting, for its first or its next slice: it is removed, and its `done`
  // is never called. When this returns, the job has released what it holds. Returns false if the job is
  // running or done. If one slice of several is running, it is the last, and `done` is called with CANCELLED.
  bool cancel(Ticket ticket);

  // The number of waiting jobs.
  size_t waiting() const;

  // Accepts no more jobs, finishes those that it has, and returns when the thread has ended. Idempotent.
  void stop();

 private:
  void run();
  void serve(FrameJob job);
  void begin_slices(FrameJob& job);
  void finish(FrameJob job, absl::StatusOr<FrameReport> report);

  const Render render_;
  Clock& clock_;
  const absl::Duration slice_;
  mutable absl::Mutex mutex_;
  std::deque<std::function<void()>> tasks_ ABSL_GUARDED_BY(mutex_);
  FrameQueue queue_ ABSL_GUARDED_BY(mutex_);
  Ticket running_ ABSL_GUARDED_BY(mutex_) = 0;       // 0: none
  bool last_slice_ ABSL_GUARDED_BY(mutex_) = false;  // the running job is cancelled
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last, because it uses all of the above
};

}  // namespace candela
