// One BakeEnvironment call: a request, and the faces of a cube map.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>

#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/rpc/server_call.h"
#include "server/rpc/service_state.h"
#include "server/session/environment_start.h"

namespace candela {

// Goes through these states, and may finish in any of them: request -> queued -> sending. The bake runs in
// slices. Its textures are freed before its faces are sent.
class BakeEnvironmentCall final : public ServerCall {
 public:
  // `state` outlives the call.
  static BakeEnvironmentCall* begin(grpc::CallbackServerContext* context, ServiceState& state);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;

 private:
  enum class State { kRequest, kQueued, kSending };
  struct Work;

  BakeEnvironmentCall(grpc::CallbackServerContext* context, ServiceState& state);
  std::shared_ptr<BakeEnvironmentCall> self() {
    return std::static_pointer_cast<BakeEnvironmentCall>(shared_from_this());
  }

  void on_entered() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_idle() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_finish(const absl::Status& status, const std::string& message) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Status take_request() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_memory() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status enqueue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void send_next() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  ServiceState& state_;
  const ClientId client_;
  const Flow flow_;
  std::optional<ClientPresence::Visit> visit_ ABSL_GUARDED_BY(mutex_);
  grpc::ByteBuffer incoming_;  // belongs to gRPC between StartRead and OnReadDone
  grpc::ByteBuffer outgoing_;  // belongs to gRPC between StartWrite and OnWriteDone
  State at_ ABSL_GUARDED_BY(mutex_) = State::kRequest;
  std::shared_ptr<Work> work_ ABSL_GUARDED_BY(mutex_);
  Ticket ticket_ ABSL_GUARDED_BY(mutex_) = 0;
  // The next message to send.
  bool header_sent_ ABSL_GUARDED_BY(mutex_) = false;
  uint32_t face_ ABSL_GUARDED_BY(mutex_) = 0;  // over all levels
  bool face_begun_ ABSL_GUARDED_BY(mutex_) = false;
  uint32_t row_ ABSL_GUARDED_BY(mutex_) = 0;
  absl::Time last_progress_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace candela
