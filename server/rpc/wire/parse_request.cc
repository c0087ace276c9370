#include "server/rpc/wire/parse_request.h"

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/message_wire.h"

namespace candela {
namespace {

// Room for the largest colour table and for every other field at its longest value.
constexpr size_t kMaxRequestBytes = v1::kMaxTableBytes + (64 << 10);

}  // namespace

absl::Status parse_request(grpc::ByteBuffer& message, google::protobuf::Message& request) {
  if (message.Length() > kMaxRequestBytes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "message has %d bytes; a message without a band has at most %d, so send the start of the call or "
        "frame first and its bands after it",
        message.Length(), kMaxRequestBytes));
  }
  if (!v1::unpack(message, request)) {
    return absl::InvalidArgumentError(
        "message does not match render.proto: its bytes are damaged or truncated");
  }
  return absl::OkStatus();
}

}  // namespace candela
