// What carries one call: messages in both directions, and its end.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include <string>

#include "absl/time/time.h"

namespace candela {

// Tells its ServerCall of every event, and never from inside one of these methods. It lives until the call's
// on_done() has returned. Any thread.
class CallTransport {
 public:
  virtual ~CallTransport() = default;

  // One read at a time: on_read_done() follows. So does on_write_done() after a write. The message belongs to
  // the transport until then.
  virtual void start_read(grpc::ByteBuffer* message) = 0;
  virtual void start_write(const grpc::ByteBuffer* message) = 0;
  // Once. on_done() follows when every read and write has ended.
  virtual void finish(const grpc::Status& status) = 0;
  // Drops the connection to the client: on_cancel() follows, unless the call is done.
  virtual void cancel() = 0;

  virtual bool is_cancelled() const = 0;
  // The client's; InfiniteFuture if it has none.
  virtual absl::Time deadline() const = 0;
  // The client's address, as the log names it.
  virtual std::string peer() const = 0;
  // See is_straight_from_this_host().
  virtual bool straight_from_this_host() const { return false; }
  // See client_identity().
  virtual std::string identity(bool tokens) const = 0;
};

}  // namespace candela
