// The render thread. It takes frames from the queue and renders them one at a time.
#pragma once

#include <deque>
#include <functional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/schedule/frame_queue.h"

namespace candela {

// Any thread may call it. A `done` callback must not call stop().
class RenderLoop {
 public:
  // Runs a job to completion: render_frame, or a substitute in tests. Called on the render thread.
  using Render = std::function<absl::StatusOr<FrameReport>(const FrameJob&)>;

  // At most `capacity` frames wait at a time.
  RenderLoop(Render render, size_t capacity);
  // Calls stop().
  ~RenderLoop();

  // Queues the job. Its `done` is called with the rendered frame, with the renderer's error, or with
  // DEADLINE_EXCEEDED if its turn came too late. UNAVAILABLE if the queue is full or the loop is stopping;
  // then `done` is never called.
  absl::StatusOr<Ticket> submit(FrameJob job);

  // Runs `task` on the render thread ahead of the waiting frames, for work that needs the renderer but is not
  // a frame. UNAVAILABLE if the loop is stopping; then the task never runs.
  absl::Status post(std::function<void()> task);

  // Returns true if the job was still waiting: it is removed and its `done` is never called. Returns false if
  // the job is running or done.
  bool cancel(Ticket ticket);

  // The number of waiting frames.
  size_t waiting() const;

  // Accepts no more jobs, finishes those that it has, and returns when the thread has ended. Idempotent.
  void stop();

 private:
  void run();
  void serve(FrameJob job);

  const Render render_;
  mutable absl::Mutex mutex_;
  std::deque<std::function<void()>> tasks_ ABSL_GUARDED_BY(mutex_);
  FrameQueue queue_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last, because it uses all of the above
};

}  // namespace candela
