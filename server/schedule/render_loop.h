// The queue of frames and the render thread: who is next, the steps of a frame there, their metrics, and the
// loop.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/base/clock.h"
#include "server/base/metrics.h"
#include "server/base/slices.h"
#include "server/render/frame_maker.h"

namespace candela {

// The phases of a frame that a job runs: metering, drawing, or both.
enum class Work { kRender, kMeter, kDraw };

// A frame on its way through the server. Its memory returns to the pool when the last holder releases it.
// Only the render thread touches it between submission and the call of `done`.
struct Frame {
  std::shared_ptr<FrameMaker> renderer;  // stays alive while the memory is in use; null only in tests
  FrameMemory memory;
  Settings settings;
  uint64_t sequence = 0;                          // the client's number, which seeds the dither
  std::optional<Metered> metered = std::nullopt;  // set by kMeter and kRender, used by kDraw
  // Makes the frame's pixels, once, before it is metered. Null: they came from the client.
  std::function<absl::Status(FrameMemory&)> source = nullptr;
  bool long_source = false;         // the source goes through checkpoint(), and may take longer than a slice
  std::vector<StageTime> stages{};  // of the work that was done for this frame before it was submitted
  bool image_in_memory = false;     // the image goes to the client's own memory: see FrameMemory::share
};

struct RenderedFrame {
  FrameReport report;
  absl::Duration queued;  // from submission to the end of rendering, without the time for which it ran
};

// Identifies a submitted job. Tickets are never reused.
using Ticket = uint64_t;

// Identifies the session that a frame belongs to, or the connection that called Render. Each flow gets a fair
// share of the device.
using Flow = uint64_t;

// A frame, or other work for the device.
struct FrameJob {
  std::shared_ptr<Frame> frame;  // null if there is a `task`
  Work work = Work::kRender;
  // Decides the exposure of the frame between metering and drawing. Called once, on the render thread; unused
  // and may be null for kMeter.
  std::function<Exposed(const FrameStats&)> decide = nullptr;
  // Work that is not a frame, such as measuring. It runs in slices. It may use the device and everything else
  // that belongs to the render thread, which waits meanwhile; at a checkpoint other jobs use them. Its error
  // is the job's.
  std::function<absl::Status()> task = nullptr;
  // The frame is rendered in slices, because it takes long. The render loop also sets this for frames with
  // FrameMemory::takes_long() and for those with a long source.
  bool in_slices = false;
  // The flow's later jobs wait for the end of this one, as frames of a session do. Otherwise those of its
  // jobs that run in slices alternate with the rest. A task is never ordered.
  bool ordered = true;
  Flow flow = 0;
  absl::Time deadline = absl::InfiniteFuture();  // the job fails if its first turn comes later than this
  // Called once, on the render thread, unless the job was removed first. Does not block. After a task the
  // report is empty.
  std::function<void(absl::StatusOr<RenderedFrame>)> done = nullptr;

  // The rest is set by the queue and the render loop.
  absl::Time submitted = {};
  Ticket ticket = 0;
  absl::Duration ran = absl::ZeroDuration();
  std::shared_ptr<absl::StatusOr<FrameReport>> report = nullptr;  // written by `slices`
  std::unique_ptr<SlicedWork> slices = nullptr;                   // of a job that has begun
};

// Meters, decides and draws, as far as the job asks for it, with the frame's own renderer. After kMeter the
// report holds only the statistics and the stages.
absl::StatusOr<FrameReport> render_frame(const FrameJob& job);

// Runs the job's task, or renders its frame.
absl::StatusOr<FrameReport> run_job(const FrameJob& job);

// Serves flows fairly, by device time. The next job comes from the flow that will have used the least device
// time after it, if the job takes as long as the flow's last one did. So a small frame does not wait for a
// slice of each of many flows. Ordered jobs of one flow keep their order, and the others alternate. A new
// flow, or one that returns after a pause, starts at the current fair share: it cannot claim time that it did
// not use, and no number of new flows starves an old one. (This is the virtual time of J. Bennett and H.
// Zhang, "Hierarchical packet fair queueing algorithms", 1997, with the measured time as the cost.) Not
// thread-safe. A job that runs in slices is charged for each and then goes back to its flow, so slices of
// several flows alternate.
class FrameQueue {
 public:
  explicit FrameQueue(size_t capacity) : capacity_(capacity) {}

  // UNAVAILABLE if the queue is full.
  absl::StatusOr<Ticket> push(FrameJob job);
  std::optional<FrameJob> pop();
  // Puts a job that pop() returned back to the front of its flow if it is ordered, otherwise to the end. Does
  // so even if the queue is full.
  void put_back(FrameJob job);
  // Charges `flow` for the device time that its job took. Call it before the next pop().
  void charge(Flow flow, absl::Duration time);
  // Charges `flow` for work on other threads that only this flow causes.
  void charge_elsewhere(Flow flow, absl::Duration time);
  // Removes a waiting job from the queue. Returns nothing if it is not waiting.
  std::optional<FrameJob> remove(Ticket ticket);

  bool empty() const { return waiting_ == 0; }
  size_t size() const { return waiting_; }
  size_t flows() const { return shares_.size(); }  // whose device time is counted

 private:
  struct Share {
    absl::Duration used;                         // on the queue's own clock
    absl::Duration last = absl::ZeroDuration();  // what its last job or slice took; 0 for a new flow
    std::deque<FrameJob> jobs{};
  };

  const size_t capacity_;
  Ticket next_ticket_ = 1;
  size_t waiting_ = 0;
  // The device time of a flow that always had jobs waiting. New flows start here.
  absl::Duration clock_ = absl::ZeroDuration();
  std::map<Flow, Share> shares_;
};

// Metrics that every call with frames reports.

// Records the stages of a rendered frame, including its time in the queue.
void count_stages(Metrics& metrics, const RenderedFrame& rendered);

// The reason for which a frame was refused before it had memory. Nothing if the client left or went silent.
std::optional<Rejection> rejection_of(const absl::Status& status);

// The reason for which a session's open message was refused. Before a session is open, only its token has an
// unmet precondition, and only a draining server is unavailable.
std::optional<Rejection> rejection_at_open(const absl::Status& status);

// What the render thread does, a step at a time: jobs from the queue, long ones in slices.
//
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

// The render thread.
//
// Steps with a thread that calls them. Any thread may call it. A `done` callback must not call stop().
class RenderLoop final : public RenderSteps {
 public:
  RenderLoop(Render render, size_t capacity, Clock& clock, absl::Duration slice = kSlice);
  // Calls stop().
  ~RenderLoop();

  // Accepts no more jobs, finishes those that it has, and returns when the thread has ended. Idempotent.
  void stop();

 private:
  std::thread thread_;
};

}  // namespace candela
