// Parsing of the messages of a call that hold no pixels.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"

namespace candela {

// Parses `message`, which holds no band, into `request`. INVALID_ARGUMENT if it is too long for such a
// message, or damaged.
absl::Status parse_request(grpc::ByteBuffer& message, google::protobuf::Message& request);

}  // namespace candela
