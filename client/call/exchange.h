// The parts of a call that single frames and environments share.
#pragma once

#include <google/protobuf/message.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/call/incoming_bands.h"
#include "client/call/raw_call.h"
#include "client/call/wire.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/message_wire.h"
#include "server/base/status_macros.h"

namespace candela {

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
