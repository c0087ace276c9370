// One Render or Meter call: the protocol from its start message to its last band.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/rpc/admission.h"
#include "server/rpc/band_reader.h"
#include "server/rpc/result_writer.h"
#include "server/rpc/server_call.h"
#include "server/rpc/service_state.h"
#include "server/session/render_start.h"

namespace candela {

// Goes through these states, and may finish in any of them:
//
//   start -> first band -> admission -> bands -> queued -> sending
//
// A frame that cannot be admitted at once is refused, so admission only takes time if a view's environment
// has to be prepared.
class RenderCall final : public ServerCall {
 public:
  // `state` outlives the call. kMeter answers with one MeterResponse.
  static std::shared_ptr<ServerCall> begin(CallTransport& transport, ServiceState& state, Work work);

  void on_read_done(bool ok) override;
  void on_write_done(bool ok) override;

 private:
  enum class State { kStart, kFirstBand, kAdmission, kBands, kQueued, kSending };

  RenderCall(CallTransport& transport, ServiceState& state, Work work);
  std::shared_ptr<RenderCall> self() { return std::static_pointer_cast<RenderCall>(shared_from_this()); }

  void on_entered() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_idle() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_finish(const absl::Status& status, const std::string& message) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Status take_start() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void admit() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_admitted(absl::StatusOr<std::shared_ptr<Frame>> admitted) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_band() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status enqueue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_rendered(absl::StatusOr<RenderedFrame> rendered) ABSL_LOCKS_EXCLUDED(mutex_);
  void send_next() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // The client is too slow. That is no failure of this server, so a frame counts as cancelled.
  void give_up_on_client(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void count_end(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  ServiceState& service_;
  const Work work_;
  const ClientId client_;
  const Flow flow_;  // of the client, however many connections it has
  std::optional<ClientPresence::Visit> visit_ ABSL_GUARDED_BY(mutex_);
  grpc::ByteBuffer incoming_;  // belongs to the transport until on_read_done
  grpc::ByteBuffer outgoing_;  // belongs to the transport until on_write_done
  Admission admission_ ABSL_GUARDED_BY(mutex_);
  State state_ ABSL_GUARDED_BY(mutex_) = State::kStart;
  std::optional<ClientPixels> shared_ ABSL_GUARDED_BY(mutex_);
  std::optional<RenderStart> start_ ABSL_GUARDED_BY(mutex_);
  std::shared_ptr<Frame> frame_ ABSL_GUARDED_BY(mutex_);
  std::optional<BandReader> bands_ ABSL_GUARDED_BY(mutex_);
  Ticket ticket_ ABSL_GUARDED_BY(mutex_) = 0;
  std::optional<ResultWriter> result_ ABSL_GUARDED_BY(mutex_);
  const absl::Time begun_;
  absl::Time admitted_ ABSL_GUARDED_BY(mutex_);
  absl::Time last_progress_ ABSL_GUARDED_BY(mutex_);
  bool client_too_slow_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace candela
