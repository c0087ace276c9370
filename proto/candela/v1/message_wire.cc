#include "proto/candela/v1/message_wire.h"

#include <grpcpp/support/proto_buffer_reader.h>
#include <grpcpp/support/slice.h>

namespace candela::v1 {

grpc::ByteBuffer pack(const google::protobuf::Message& message) {
  const grpc::Slice bytes(message.SerializeAsString());
  return grpc::ByteBuffer(&bytes, 1);
}

bool unpack(grpc::ByteBuffer& bytes, google::protobuf::Message& message) {
  grpc::ProtoBufferReader slices(&bytes);
  return message.ParseFromZeroCopyStream(&slices);
}

}  // namespace candela::v1
