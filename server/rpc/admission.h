// Admission of a frame: its tier, its memory and its session's look-ahead, before its pixels may arrive.
#pragma once

#include <grpcpp/alarm.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/rpc/server_call.h"
#include "server/rpc/service_state.h"

namespace candela {

// Admits the frames of one call, one after the other. Pixels are read only after that, so that a client whose
// frame is not admitted is held back by HTTP/2 flow control or refused, and is never buffered. All methods
// are called under the call's mutex.
class Admission {
 public:
  struct Request {
    FrameDesc desc;
    uint64_t sequence = 0;
    Settings settings;
    Verify verify = Verify::kNo;
    bool choose_tier = false;  // the settings promise an accuracy or a time instead of naming a tier
    uint32_t lookahead = 0;    // frames; memory for as many more is reserved
    // The time to retry, once for the tier and once for the memory, while either is UNAVAILABLE. 0: refuse at
    // once.
    absl::Duration patience = absl::ZeroDuration();
  };
  struct Admitted {
    std::shared_ptr<Frame> frame;
    std::optional<TierChoice> choice;  // if a tier was chosen
  };
  // Called once, under the call's mutex: within begin(), on the render thread or on a thread of gRPC. Fails
  // as TierBenchmark::choose, Renderer::allocate and RenderLoop::post do, and with RESOURCE_EXHAUSTED or
  // UNAVAILABLE if there is no memory for the look-ahead.
  using Done = std::function<void(absl::StatusOr<Admitted>)>;

  // `call` owns this object.
  Admission(ServerCall& call, Rendering& rendering, LookaheadMemory& lookahead_memory)
      : call_(call), rendering_(rendering), lookahead_memory_(lookahead_memory) {}

  // Begins with the next frame; the one before is admitted.
  void begin(Request request, Done done);

  // Gives up: `done` is not called any more.
  void cancel();
  // The call ends: gives up and releases the look-ahead reservation.
  void end();

 private:
  void proceed();
  void choose_tier();
  void on_choice(absl::StatusOr<TierChoice> choice);
  void allocate();
  absl::Status reserve_lookahead(const FrameMemory& memory);
  bool retry_after(const absl::Status& status);
  void complete(absl::StatusOr<Admitted> outcome);

  ServerCall& call_;
  Rendering& rendering_;
  LookaheadMemory& lookahead_memory_;
  Request request_;
  Done done_;  // null if there is no frame to admit
  std::optional<TierChoice> choice_;
  absl::Time deadline_;
  std::unique_ptr<grpc::Alarm> alarm_;
  uint64_t reserved_bytes_ = 0;  // of the look-ahead memory; grows with the largest frame
};

}  // namespace candela
