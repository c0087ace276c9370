// Reads the server's answer to a Render call, message by message.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/call/incoming_bands.h"
#include "client/render_result.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// The request that the answer must match.
struct ResultRequest {
  v1::ImageSize frame{1, 1};  // of the frame that was sent
  v1::ImageSize image{1, 1};  // that its settings ask for
  bool verify = false;
  bool error_map = false;
  std::optional<double> exposure = std::nullopt;  // of the frame itself
};

// Used by one thread at a time.
class ResultReader {
 public:
  explicit ResultReader(const ResultRequest& request) : request_(request) {}

  // Takes the next message: first the header, for which it allocates the memory, then bands of the image and
  // of the error map, which it copies into place. Returns UNIMPLEMENTED for a header without the requested
  // size, verification or exposure, RESOURCE_EXHAUSTED if this process lacks the memory, and
  // not_the_protocol() for any other unexpected message. Must not be called after a failure.
  absl::Status read(grpc::ByteBuffer& message);

  // Returns the image. To be called once. not_the_protocol() if rows of it or of the map are missing.
  absl::StatusOr<RenderResult> take();

 private:
  absl::Status take_header(grpc::ByteBuffer& message);

  const ResultRequest request_;
  RenderResult result_;
  IncomingBands image_{v1::kImageBand};
  IncomingBands map_{v1::kErrorMapBand};
};

}  // namespace candela
