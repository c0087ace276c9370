// Pixels that arrive in bands, and what is said of a server that sends anything else.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/band_wire.h"

namespace candela {

// INTERNAL, "server's answer is not what render.proto says: <what>".
absl::Status not_the_protocol(const char* what);

// 0 for a format that this client does not know.
uint64_t bytes_per_pixel(v1::OutputFormat format);

// One thread at a time. Empty, it is whole.
class IncomingBands {
 public:
  explicit IncomingBands(v1::BandKind kind) : kind_(kind) {}

  // Rows of `row_bytes` are to fill `bytes`, which the caller keeps.
  void begin(std::span<std::byte> bytes, uint64_t row_bytes);

  // Takes the next message: rows that follow those taken so far, copied to their places, or
  // not_the_protocol.
  absl::Status take(grpc::ByteBuffer& message);

  bool whole() const { return at_ == bytes_.size(); }
  bool empty() const { return bytes_.empty(); }

 private:
  v1::BandKind kind_;
  std::span<std::byte> bytes_{};
  uint64_t row_bytes_ = 0;
  size_t at_ = 0;  // how much of it is there
};

}  // namespace candela
