// The frames that wait to be rendered, and the order in which they are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/render/renderer.h"

namespace candela {

// What of a frame a job does: both phases, or one of them.
enum class Work { kRender, kMeter, kDraw };

// A frame on its way through the server. Whoever fills, renders or sends it holds it; when the last of them
// lets go, the memory returns to the pool. Between submission and `done` the render thread has it alone.
struct Frame {
  std::shared_ptr<Renderer> renderer;  // kept alive for as long as its memory is in use; may be null
  FrameMemory memory;
  Settings settings;
  FrameMoment moment;
  Work work = Work::kRender;
  // Gives the exposure once the frame is metered, on the render thread; null: by `moment` alone.
  std::function<Exposed(const FrameStats&)> expose = nullptr;
  std::optional<Metered> metered = std::nullopt;  // after kMeter, for kDraw
};

// Does the frame's work with its own renderer; after kMeter the report holds the statistics and stages alone.
absl::StatusOr<FrameReport> render_frame(Frame& frame);

struct RenderedFrame {
  FrameReport report;
  absl::Duration queued;  // from submission to the start of its rendering
};

// Whose frames they are: a session, or a connection that calls Render. Each has its share of the device.
using Flow = uint64_t;

struct FrameJob {
  std::shared_ptr<Frame> frame;
  Flow flow = 0;
  absl::Time deadline = absl::InfiniteFuture();  // not rendered when this has passed before its turn
  absl::Time submitted;                          // set by the render loop
  // Called once, on the render thread, unless the job was removed first. Does not block.
  std::function<void(absl::StatusOr<RenderedFrame>)> done;
};

// Names a job from its submission on; never reused.
using Ticket = uint64_t;

// Bounded. The flow that had the least of the device's time is next; within a flow it is first come, first
// served. A new flow, or one that comes back after a pause, begins with what is a fair share by then: it has
// no claim on the time that it did not use, and any number of them do not keep a flow waiting that has had
// its share. (The virtual time of J. Bennett and H. Zhang, "Hierarchical packet fair queueing algorithms",
// 1997, with the measured time as the cost.) Not thread-safe.
class FrameQueue {
 public:
  explicit FrameQueue(size_t capacity) : capacity_(capacity) {}

  // UNAVAILABLE when it is full.
  absl::StatusOr<Ticket> push(FrameJob job);
  std::optional<FrameJob> pop();
  // What a job of that flow took of the device's time; before the next pop().
  void charge(Flow flow, absl::Duration time);
  // Takes a job that waits out of the queue; nothing when it no longer waits.
  std::optional<FrameJob> remove(Ticket ticket);

  bool empty() const { return waiting_ == 0; }
  size_t size() const { return waiting_; }
  size_t flows() const { return shares_.size(); }  // that it keeps account of

 private:
  struct Entry {
    Ticket ticket;
    FrameJob job;
  };
  struct Share {
    absl::Duration used;  // on the queue's own clock
    std::deque<Entry> jobs{};
  };

  const size_t capacity_;
  Ticket next_ticket_ = 1;
  size_t waiting_ = 0;
  // What a flow that always had frames waiting would have used by now: where a new flow begins.
  absl::Duration clock_ = absl::ZeroDuration();
  std::map<Flow, Share> shares_;
};

}  // namespace candela
