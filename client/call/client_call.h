// A call that sends and receives messages at the same time, as the one who drives it sees it.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace candela {

// What the driver of calls is told.
enum class CallEvent {
  kTimeout,   // the time that it named has passed
  kWoken,     // somebody has something for it, see CallQueue::wake()
  kWritable,  // can_write() may be true now
  kMessage,   // message() holds the next message
  kEnded,     // status() says how; no other event of this call follows
};

// It begins when it is made. Used by one thread. Events never come from inside a member; they are passed on
// later.
class ClientCall {
 public:
  virtual ~ClientCall() = default;

  // Whether a write may start: the previous one is done and the call continues.
  virtual bool can_write() const = 0;
  // Whether a write is in progress: not all of it has been passed on yet.
  virtual bool writing() const = 0;
  virtual void write(const grpc::ByteBuffer& message) = 0;
  virtual void half_close() = 0;  // takes the place of a write; none may follow

  virtual grpc::ByteBuffer& message() = 0;
  // The message is used, and the next one may come. Due after each kMessage.
  virtual void read() = 0;

  // Asks for the call's end; kEnded follows soon.
  virtual void cancel() = 0;

  // All that follows is for after the end. A status that the server gave, or what ended the call.
  virtual const grpc::Status& status() const = 0;
  // True if the server was reached: a message was sent to it, or it refused the call with details, which may
  // come before the first message is sent.
  virtual bool connected() const = 0;
  // status() for the user. Finding out why TLS failed may take seconds.
  virtual absl::Status error() const = 0;
};

}  // namespace candela
