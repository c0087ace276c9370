// Messages as gRPC delivers them. Internal to fuzz_wire.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/slice.h>

#include <cstddef>
#include <string>
#include <vector>

namespace candela {

// A message in slices of any size. Each slice has separate memory.
inline grpc::ByteBuffer in_slices(const std::string& message, size_t slice_bytes) {
  std::vector<grpc::Slice> slices;
  for (size_t at = 0; at < message.size(); at += slice_bytes) {
    slices.emplace_back(message.substr(at, slice_bytes));
  }
  return grpc::ByteBuffer(slices.data(), slices.size());
}

}  // namespace candela
