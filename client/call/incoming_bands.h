// The pixels of an image that arrives in bands: its size, its memory, and the error for a server that breaks
// the protocol.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/render_result.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// INTERNAL, with the message "server's answer does not follow render.proto: <what>".
absl::Status not_the_protocol(const char* what);

// OK if the image of `header` has the size that was asked for. UNIMPLEMENTED if it has the frame's instead: a
// server that is too old for sizes ignores them. Otherwise not_the_protocol().
absl::Status check_image_size(const v1::ResultHeader& header, v1::ImageSize frame, v1::ImageSize asked);

// Makes result.data of result.bytes. RESOURCE_EXHAUSTED if this process lacks the memory.
absl::Status make_room(RenderResult& result);

// Collects the bands of one image. Used by one thread at a time. Before begin() it expects no rows, and none
// are missing.
class IncomingBands {
 public:
  explicit IncomingBands(v1::BandKind kind) : kind_(kind) {}

  // Starts an image: rows of `row_bytes` that fill `bytes`. The caller owns `bytes`. With `left_out` the
  // bands hold no alpha, which is 1, and the image has this format.
  void begin(std::span<std::byte> bytes, uint64_t row_bytes,
             v1::OutputFormat left_out = v1::OUTPUT_FORMAT_UNSPECIFIED);

  // Takes the next message and copies its rows into place. Returns not_the_protocol() unless they follow the
  // rows received so far.
  absl::Status take(grpc::ByteBuffer& message);

  bool whole() const { return at_ == bytes_.size(); }
  bool empty() const { return bytes_.empty(); }

 private:
  absl::StatusOr<uint64_t> take_rows(google::protobuf::io::CodedInputStream& input, uint64_t bytes) const;

  v1::BandKind kind_;
  v1::OutputFormat left_out_ = v1::OUTPUT_FORMAT_UNSPECIFIED;
  std::span<std::byte> bytes_{};
  uint64_t row_bytes_ = 0;
  size_t at_ = 0;  // bytes received so far
};

}  // namespace candela
