// Conversion between generated messages and gRPC byte buffers. For bands see band_wire.h.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>

namespace candela::v1 {

grpc::ByteBuffer pack(const google::protobuf::Message& message);

// Returns false if the bytes are not such a message.
bool unpack(grpc::ByteBuffer& bytes, google::protobuf::Message& message);

}  // namespace candela::v1
