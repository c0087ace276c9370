// The server's answer to a Render call as its messages arrive.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/band_wire.h"

namespace candela {

// A rendered image and what the server says about it. Movable.
struct RenderResult {
  v1::ResultHeader header;
  std::unique_ptr<std::byte[]> data;  // header.height rows of header.width pixels of header.format, tight
  size_t bytes = 0;
  // Where it was asked for: a half a pixel, rows from top to bottom, the largest error of R, G and B in
  // codes.
  std::vector<uint16_t> error_map;

  std::span<const std::byte> pixels() const { return {data.get(), bytes}; }
};

// INTERNAL, "server's answer is not what render.proto says: <what>".
absl::Status not_the_protocol(const char* what);

// What was asked for, which the answer has to hold.
struct ResultRequest {
  uint32_t width = 1;   // pixels, of the frame that was sent
  uint32_t height = 1;  // pixels
  bool verify = false;
  bool error_map = false;
};

// One thread at a time.
class ResultReader {
 public:
  explicit ResultReader(const ResultRequest& request) : request_(request) {}

  // Takes the next message: the header, with which the memory is taken, then bands of the image and of the
  // error map, copied to their places. UNIMPLEMENTED for a header without the verification that was asked
  // for, not_the_protocol for any other message that is not due; nothing is to be read after a failure.
  absl::Status read(grpc::ByteBuffer& message);

  // The image, once. not_the_protocol when rows of it or of the map are missing.
  absl::StatusOr<RenderResult> take();

 private:
  // What comes in bands.
  struct Incoming {
    v1::BandKind kind;
    std::span<std::byte> bytes{};
    uint64_t row_bytes = 0;
    size_t at = 0;  // how much of it is there

    bool whole() const { return at == bytes.size(); }
  };

  absl::Status take_header(grpc::ByteBuffer& message);
  static absl::Status take_band(grpc::ByteBuffer& message, Incoming& incoming);

  const ResultRequest request_;
  RenderResult result_;
  Incoming image_{v1::kImageBand};
  Incoming map_{v1::kErrorMapBand};
};

}  // namespace candela
