// The server's answer to a Render call as its messages arrive.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/call/incoming_bands.h"
#include "client/render_result.h"

namespace candela {

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
  absl::Status take_header(grpc::ByteBuffer& message);

  const ResultRequest request_;
  RenderResult result_;
  IncomingBands image_{v1::kImageBand};
  IncomingBands map_{v1::kErrorMapBand};
};

}  // namespace candela
