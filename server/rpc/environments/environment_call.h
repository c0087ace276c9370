// What the calls that put and bake environments have in common: a client, a job, messages and their idle
// time.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <functional>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include "server/rpc/server_call.h"
#include "server/rpc/service_state.h"

namespace candela {

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

}  // namespace candela
