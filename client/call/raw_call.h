// A gRPC call of raw messages, driven by the thread that owns it.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/call/channel.h"
#include "client/call/result_reader.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/status_macros.h"

namespace candela {

// Every member waits until its operation is done. A result of false means that the call is over, and finish()
// says why.
class RawCall {
 public:
  // `method` is "/package.Service/Method".
  RawCall(const std::shared_ptr<grpc::Channel>& channel, const std::string& method, absl::Time deadline);
  // Cancels the call unless it was finished.
  ~RawCall();
  RawCall(const RawCall&) = delete;
  RawCall& operator=(const RawCall&) = delete;

  bool write(const grpc::ByteBuffer& message);
  bool half_close();
  bool read(grpc::ByteBuffer& message);
  // Returns how the call ended. To be called once, after the last read.
  grpc::Status finish();

  // True if the server was reached: a message was sent to it, or it refused the call with details, which may
  // come before the first message is sent. Final after the call's end.
  bool connected() const { return connected_; }

 private:
  bool wait();

  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> stream_;
  bool started_ = false;
  bool connected_ = false;
  bool finished_ = false;
};

// Sends rows of `row_bytes` bytes in bands. Copies each band, because gRPC may keep a message after its call
// has ended. Returns false if the call is over.
bool send_bands(RawCall& call, v1::BandKind kind, uint64_t row_bytes, std::span<const std::byte> pixels);

// Finishes the call, and returns the error for the user.
absl::Status end_of(RawCall& call, const Peer& peer);

// Ends a call that has one answer. `answered` says whether `message` holds it.
template <typename Response>
absl::StatusOr<Response> answer_of(RawCall& call, bool answered, grpc::ByteBuffer& message,
                                   const Peer& peer) {
  RETURN_IF_ERROR(end_of(call, peer));
  Response response;
  if (!answered || !v1::unpack(message, response)) return not_the_protocol("it cannot be read");
  return response;
}

// Sends one message and reads one.
template <typename Response>
absl::StatusOr<Response> ask(RawCall& call, const google::protobuf::Message& request, const Peer& peer) {
  grpc::ByteBuffer message;
  const bool answered = call.write(v1::pack(request)) && call.half_close() && call.read(message);
  return answer_of<Response>(call, answered, message, peer);
}

}  // namespace candela
