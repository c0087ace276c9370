// A bounded queue of frames that is fair by device time.
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

// The phases of a frame that a job runs: metering, drawing, or both.
enum class Work { kRender, kMeter, kDraw };

// A frame on its way through the server. Its memory returns to the pool when the last holder releases it.
// Only the render thread touches it between submission and the call of `done`.
struct Frame {
  std::shared_ptr<Renderer> renderer;  // stays alive while the memory is in use; null only in tests
  FrameMemory memory;
  Settings settings;
  uint64_t sequence = 0;                          // the client's number, which seeds the dither
  std::optional<Metered> metered = std::nullopt;  // set by kMeter and kRender, used by kDraw
};

struct RenderedFrame {
  FrameReport report;
  absl::Duration queued;  // from submission to the start of rendering
};

// Identifies the session that a frame belongs to, or the connection that called Render. Each flow gets a fair
// share of the device.
using Flow = uint64_t;

struct FrameJob {
  std::shared_ptr<Frame> frame;
  Work work = Work::kRender;
  // Decides the exposure of the frame between metering and drawing. Called once, on the render thread; unused
  // and may be null for kMeter.
  std::function<Exposed(const FrameStats&)> decide = nullptr;
  Flow flow = 0;
  absl::Time deadline = absl::InfiniteFuture();  // the job fails if its turn comes later than this
  absl::Time submitted = {};                     // set by the render loop
  // Called once, on the render thread, unless the job was removed first. Does not block.
  std::function<void(absl::StatusOr<RenderedFrame>)> done = nullptr;
};

// Meters, decides and draws, as far as the job asks for it, with the frame's own renderer. After kMeter the
// report holds only the statistics and the stages.
absl::StatusOr<FrameReport> render_frame(const FrameJob& job);

// Identifies a submitted job. Tickets are never reused.
using Ticket = uint64_t;

// The next job comes from the flow that has used the least device time; jobs of one flow keep their order. A
// new flow, or one that returns after a pause, starts at the current fair share: it cannot claim time that it
// did not use, and no number of new flows starves an old one. (This is the virtual time of J. Bennett and
// H. Zhang, "Hierarchical packet fair queueing algorithms", 1997, with the measured time as the cost.) Not
// thread-safe.
class FrameQueue {
 public:
  explicit FrameQueue(size_t capacity) : capacity_(capacity) {}

  // UNAVAILABLE if the queue is full.
  absl::StatusOr<Ticket> push(FrameJob job);
  std::optional<FrameJob> pop();
  // Charges `flow` for the device time that its job took. Call it before the next pop().
  void charge(Flow flow, absl::Duration time);
  // Removes a waiting job from the queue. Returns nothing if it is no longer waiting.
  std::optional<FrameJob> remove(Ticket ticket);

  bool empty() const { return waiting_ == 0; }
  size_t size() const { return waiting_; }
  size_t flows() const { return shares_.size(); }  // that have an account

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
  // The device time of a flow that always had frames waiting. New flows start here.
  absl::Duration clock_ = absl::ZeroDuration();
  std::map<Flow, Share> shares_;
};

}  // namespace candela
