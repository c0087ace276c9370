// A call that sends and receives messages at the same time, as the one who drives it sees it.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include <cstddef>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/panorama.h"

namespace candela {

// The events of a call, which its driver gets.
enum class CallEvent {
  kTimeout,   // the driver's deadline has passed
  kWoken,     // another thread called CallQueue::wake()
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
  // Reads the next message, so message() is no longer valid. Call it once after each kMessage.
  virtual void read() = 0;

  // Asks for the call's end; kEnded follows soon.
  virtual void cancel() = 0;

  // Call this and what follows only after the end. The status that the server gave, or why the call ended
  // without one.
  virtual const grpc::Status& status() const = 0;
  // True if the server was reached: a message was sent to it, or it refused the call with details, which may
  // come before the first message is sent.
  virtual bool connected() const = 0;
  // status() for the user. Finding out why TLS failed may take seconds.
  virtual absl::Status error() const = 0;
};

// The servers of a session, as its driver sees them.
//
// Servers are counted from 0. Used by one thread.
class SessionServers {
 public:
  virtual ~SessionServers() = default;

  virtual size_t count() const = 0;
  virtual const std::string& address(size_t server) const = 0;

  // Begins a Stream call of the session with this name.
  virtual std::unique_ptr<ClientCall> call(size_t server, const std::string& session) = 0;

  // Puts the panorama on the server. SessionDriver::on_put() gets the answer, not before this returns.
  virtual void put(size_t server, std::shared_ptr<const Panorama> panorama, absl::Time deadline) = 0;
};

}  // namespace candela
