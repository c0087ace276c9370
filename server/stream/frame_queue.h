// The frames that wait to be rendered, and the order in which they are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/render/renderer.h"

namespace candela {

// A frame on its way through the server. Whoever fills, renders or sends it holds it; when the last of them
// lets go, the memory returns to the pool.
struct Frame {
  std::shared_ptr<Renderer> renderer;  // kept alive for as long as its memory is in use; may be null
  FrameMemory memory;
  Settings settings;
  FrameMoment moment;
};

struct RenderedFrame {
  FrameReport report;
  absl::Duration queued;  // from submission to the start of its rendering
};

struct FrameJob {
  std::shared_ptr<Frame> frame;
  absl::Time deadline = absl::InfiniteFuture();  // not rendered when this has passed before its turn
  absl::Time submitted;                          // set by the render loop
  // Called once, on the render thread, unless the job was removed first. Does not block.
  std::function<void(absl::StatusOr<RenderedFrame>)> done;
};

// Names a job from its submission on; never reused.
using Ticket = uint64_t;

// First come, first served, and bounded. Not thread-safe.
class FrameQueue {
 public:
  explicit FrameQueue(size_t capacity) : capacity_(capacity) {}

  // UNAVAILABLE when it is full.
  absl::StatusOr<Ticket> push(FrameJob job);
  std::optional<FrameJob> pop();
  // Takes a job that waits out of the queue; nothing when it no longer waits.
  std::optional<FrameJob> remove(Ticket ticket);

  bool empty() const { return jobs_.empty(); }

 private:
  struct Entry {
    Ticket ticket;
    FrameJob job;
  };

  const size_t capacity_;
  Ticket next_ticket_ = 1;
  std::deque<Entry> jobs_;
};

}  // namespace candela
