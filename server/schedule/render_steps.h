// What the render thread does, a step at a time: jobs from the queue, long ones in slices.
#pragma once

#include <deque>
#include <functional>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/base/clock.h"
#include "server/schedule/frame_queue.h"

namespace candela {

// One thread, the render thread, calls step(); any may call the rest. A job that runs in slices takes a
// thread of its own from its first slice to its end, but only one of all these threads runs at a time, and
// the render thread waits for it.
class RenderSteps {
 public:
  // Runs a job to completion: run_job, or a substitute in tests. Called on the render thread, or on the job's
  // own while the render thread waits.
  using Render = std::function<absl::StatusOr<FrameReport>(const FrameJob&)>;

  // At most `capacity` jobs wait at a time, those between two slices included. Tests shorten and lengthen
  // `slice`. `clock` outlives this object.
  RenderSteps(Render render, size_t capacity, Clock& clock, absl::Duration slice = kSlice);

  // Queues the job. Its `done` is called with the rendered frame, with the renderer's error, or with
  // DEADLINE_EXCEEDED if its turn came too late. UNAVAILABLE if the queue is full or this
  // is closed; then `done` is never called.
  absl::StatusOr<Ticket> submit(FrameJob job);

  // Counts `time` as device time of `flow`: that of work on other threads that only this flow causes.
  void charge(Flow flow, absl::Duration time);

  // Runs `task` on the render thread ahead of the waiting jobs. Only for the heartbeat. What clients ask for
  // goes through submit(). UNAVAILABLE if this is closed; then the task never runs.
  absl::Status post(std::function<void()> task);

  // Returns true if the job was still waiting, for its first or its next slice: it is removed, and its `done`
  // is never called. When this returns, the job has released what it holds. Returns false if the job is
  // running or done. If one slice of several is running, it is the last, and `done` is called with CANCELLED.
  bool cancel(Ticket ticket);

  // The number of waiting jobs.
  size_t waiting() const;

  // Runs a task, a job or a slice of one. Returns false if there is none.
  bool step();

  // Accepts no more jobs and tasks. Those that it has can still be run.
  void close();

 protected:
  // Waits for something that step() can run. Returns false if there is nothing, and this is closed.
  bool wait();

 private:
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
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace candela
