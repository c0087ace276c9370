// The calls for environments: put a panorama, bake one.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/candela/v1/environment_id.h"
#include "server/rpc/band_reader.h"
#include "server/rpc/server_call.h"
#include "server/rpc/service_state.h"
#include "server/session/environment_start.h"

namespace candela {

// What the calls that put and bake environments have in common: a client, a job, messages and their idle
// time.
//
// Reads messages, has one job run, and sends messages. A client that sends or reads nothing for the idle
// timeout ends the call, except while its job waits or runs.
class EnvironmentCall : public ServerCall {
 protected:
  // `state` outlives the call.
  EnvironmentCall(CallTransport& transport, ServiceState& state);

  // The next message, or the client's half-close if there is none: returns how the call ends, if it ends.
  virtual absl::Status on_read(bool message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) = 0;
  // The message of send() is out.
  virtual void on_sent() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) = 0;

  // Runs `task` on the render thread, in slices and in the client's flow. Then calls `then` under the mutex,
  // unless the call has finished or the job failed, which ends the call.
  absl::Status work(std::function<absl::Status()> task, std::function<void()> then)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void send(grpc::ByteBuffer message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // An error if an upload has to end; the last message came `idle` ago.
  virtual absl::Status check_upload(absl::Time now, absl::Duration idle)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) = 0;

  void on_finish(const absl::Status& status, const std::string& message) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  ServiceState& state_;
  const ClientId client_;
  grpc::ByteBuffer incoming_;  // belongs to the transport until on_read_done

 private:
  void on_read_done(bool ok) final;
  void on_write_done(bool ok) final;
  void on_entered() final ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_idle() final ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  std::optional<ClientPresence::Visit> visit_ ABSL_GUARDED_BY(mutex_);
  std::optional<Ticket> ticket_ ABSL_GUARDED_BY(mutex_);  // of the job, until it has run
  bool sending_ ABSL_GUARDED_BY(mutex_) = false;
  grpc::ByteBuffer outgoing_;  // belongs to the transport until on_write_done
  absl::Time last_progress_ ABSL_GUARDED_BY(mutex_);
};

// One PutEnvironment call: a panorama's upload, and what is found out about it.
//
// Goes through these states, and may finish in any of them:
//
//   start -> first band -> bands -> whole
//
// The panorama gets its memory when the first band is here, as frames do.
class PutEnvironmentCall final : public EnvironmentCall {
 public:
  // `state` outlives the call.
  static std::shared_ptr<ServerCall> begin(CallTransport& transport, ServiceState& state);

 private:
  enum class State { kStart, kFirstBand, kBands, kWhole };
  // What the render thread works on.
  struct Work;

  using EnvironmentCall::EnvironmentCall;

  absl::Status on_read(bool message) override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_sent() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status check_upload(absl::Time now, absl::Duration idle) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_finish(const absl::Status& status, const std::string& message) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Status take_start() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_memory() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_band() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_half_close() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status enqueue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void answer(const v1::Environment& environment) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  State reading_ ABSL_GUARDED_BY(mutex_) = State::kStart;
  std::optional<PanoramaStart> start_ ABSL_GUARDED_BY(mutex_);
  std::optional<v1::EnvironmentId> id_ ABSL_GUARDED_BY(mutex_);
  std::optional<BandReader> bands_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::byte> rows_ ABSL_GUARDED_BY(mutex_);  // of the band that is read
  uint32_t rows_read_ ABSL_GUARDED_BY(mutex_) = 0;
  std::shared_ptr<Work> work_ ABSL_GUARDED_BY(mutex_);
  absl::Time admitted_ ABSL_GUARDED_BY(mutex_);
};

// One BakeEnvironment call: a request, and the faces of a cube map.
//
// The bake's textures are freed before its faces are sent.
class BakeEnvironmentCall final : public EnvironmentCall {
 public:
  // `state` outlives the call.
  static std::shared_ptr<ServerCall> begin(CallTransport& transport, ServiceState& state);

 private:
  struct Work;

  using EnvironmentCall::EnvironmentCall;

  absl::Status on_read(bool message) override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_sent() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status check_upload(absl::Time, absl::Duration) override { return absl::OkStatus(); }
  void on_finish(const absl::Status& status, const std::string& message) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Status take_request() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_memory() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status enqueue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  std::shared_ptr<Work> work_ ABSL_GUARDED_BY(mutex_);
  // The next message to send.
  bool header_sent_ ABSL_GUARDED_BY(mutex_) = false;
  uint32_t face_ ABSL_GUARDED_BY(mutex_) = 0;  // over all levels
  bool face_begun_ ABSL_GUARDED_BY(mutex_) = false;
  uint32_t row_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace candela
