// Admission of a frame: its memory and its session's look-ahead, when its first pixels are here.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/rpc/server_call.h"
#include "server/rpc/service_state.h"
#include "server/session/environment_start.h"

namespace candela {

// Admits the frames of one call, one after the other. A frame is admitted when its first band has come, so
// that headers alone take no memory. No more bands are read until then: a client whose frame is not admitted
// is held back by HTTP/2 flow control or refused, and is never buffered. All methods are called under the
// call's mutex.
class Admission {
 public:
  struct Request {
    FrameDesc desc;
    uint64_t sequence = 0;
    Settings settings;
    Verify verify = Verify::kNo;
    Flow flow = 0;                         // is charged for preparing an environment
    EnvironmentUse environment = nullptr;  // of a view; null: the frame has pixels
    View view = {};
    uint32_t lookahead = 0;  // frames; memory for as many more is reserved
    // The time to retry while there is no memory. 0: refuse at once.
    absl::Duration patience = absl::ZeroDuration();
  };
  // Called once, under the call's mutex: within begin(), on the render thread or on a thread of gRPC. Fails
  // as FrameMaker::allocate and RenderSteps::submit do, and with RESOURCE_EXHAUSTED or UNAVAILABLE if there
  // is no memory for the look-ahead.
  using Done = std::function<void(absl::StatusOr<std::shared_ptr<Frame>>)>;

  // `call` owns this object. Its frames are `client`'s.
  Admission(ServerCall& call, ServiceState& state, ClientId client)
      : call_(call),
        clock_(state.clock),
        rendering_(state.rendering),
        memory_(*state.sessions.memory),
        environments_(state.environments),
        client_(client) {}

  // The next frame has its header; the one before is admitted. Allocates nothing. RESOURCE_EXHAUSTED if the
  // frame or its look-ahead can never be admitted.
  absl::Status expect(Request request);
  // Its first band is here.
  void begin(Done done);

  // Gives up: `done` is not called any more.
  void cancel();
  // The call ends: gives up and releases the look-ahead reservation.
  void end();

 private:
  void proceed();
  void prepare_environment();
  // Runs `task` on the render thread, in slices, in the request's flow and within turn_; then calls `then`
  // with its status, under the call's mutex.
  void work(std::function<absl::Status()> task, std::function<void(const absl::Status&)> then);
  void stop_working();
  void allocate();
  absl::StatusOr<FrameMemory> take_memory(FrameMaker& renderer);
  absl::Status check_lookahead(uint64_t frame_bytes) const;
  absl::Status reserve_lookahead(uint64_t frame_bytes);
  bool retry_after(const absl::Status& status);
  void proceed_after(absl::Duration delay);
  void complete(absl::StatusOr<std::shared_ptr<Frame>> outcome);

  ServerCall& call_;
  Clock& clock_;
  Rendering& rendering_;
  ClientMemory& memory_;
  EnvironmentStore& environments_;
  const ClientId client_;
  Request request_;
  Done done_;                      // null if there is no frame to admit
  std::optional<Ticket> working_;  // the job that prepares the environment
  std::shared_ptr<void> turn_;     // held while it does
  std::vector<StageTime> stages_;  // of the environment's preparation
  absl::Time deadline_;
  std::unique_ptr<Timer> timer_;
  uint64_t reserved_bytes_ = 0;  // of the look-ahead memory; grows with the largest frame
};

// Makes `request` one for a view. `held` is the environment of the session's last view, or null. The session
// may use it even after DropEnvironment; only a lost device takes it away. NOT_FOUND naming the environment
// if the server does not have it; INVALID_ARGUMENT naming the view's field.
absl::Status use_view(const v1::View& view, const EnvironmentUse& held, ServiceState& state,
                      Admission::Request& request);

}  // namespace candela
