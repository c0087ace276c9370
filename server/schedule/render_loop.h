// The one thread that renders: it takes frames from the queue, one at a time.
#pragma once

#include <deque>
#include <functional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/schedule/frame_queue.h"

namespace candela {

// Any thread may call it, except that `done` callbacks do not stop it.
class RenderLoop {
 public:
  // What does a frame's work to completion: render_frame, or a test's stand-in. Called by one thread.
  using Render = std::function<absl::StatusOr<FrameReport>(Frame&)>;

  // At most `capacity` frames wait at a time.
  RenderLoop(Render render, size_t capacity);
  // As stop().
  ~RenderLoop();

  // Takes the job: its `done` is called with the rendered frame, with the renderer's error, or with
  // DEADLINE_EXCEEDED when its turn came too late. UNAVAILABLE, and the job is dropped without a call, when
  // the queue is full or the loop stops.
  absl::StatusOr<Ticket> submit(FrameJob job);

  // Runs `task` on the render thread, before the frames that wait; for work that needs the renderer and is no
  // frame. UNAVAILABLE, and the task is dropped, when the loop stops.
  absl::Status post(std::function<void()> task);

  // True: the job had not begun, is gone, and its `done` is never called. False: it is being rendered or
  // done.
  bool cancel(Ticket ticket);

  // Frames that wait for their turn.
  size_t waiting() const;

  // Takes no more jobs, finishes those it has, and returns when the thread has ended. Idempotent.
  void stop();

 private:
  void run();
  void serve(FrameJob job);

  const Render render_;
  mutable absl::Mutex mutex_;
  std::deque<std::function<void()>> tasks_ ABSL_GUARDED_BY(mutex_);
  FrameQueue queue_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace candela
