// Messages of the generated classes as gRPC carries them; for bands see band_wire.h.
#pragma once

#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>

namespace candela::v1 {

grpc::ByteBuffer pack(const google::protobuf::Message& message);

// False for bytes that are no such message.
bool unpack(grpc::ByteBuffer& bytes, google::protobuf::Message& message);

}  // namespace candela::v1
