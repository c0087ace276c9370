// Reads the server's messages of a session call.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <memory>
#include <string>
#include <variant>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/call/incoming_bands.h"
#include "client/call/memory/shared_region.h"
#include "client/render_result.h"
#include "client/session.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// The meaning of a message.
struct MoreToCome {};  // part of a result
struct FrameAnswer {
  absl::Status status;  // the frame's own
  RenderResult image;   // if status is OK
  std::string token;    // the session can resume after this frame with it; may be empty
};
using StreamEvent = std::variant<MoreToCome, v1::StreamOpened, FrameAnswer, v1::GoAway>;

// The frame that the next result must be for.
struct DueFrame {
  std::shared_ptr<const SessionFrame> frame;  // null: no result is due
  v1::ImageSize image;                        // that its settings ask for
  SharedRegion::Area place{};                 // where the server may put it
};

// The requests of the session's open message.
struct StreamRequested {
  bool image = true;   // with every result
  bool state = false;  // in every result's header
};

// Reads one call. Used by one thread at a time.
class StreamReader {
 public:
  explicit StreamReader(const StreamRequested& requested = {}) : requested_(requested) {}

  // Takes the next message. `due` must stay the same until the frame has its answer. Returns
  // not_the_protocol() for an unexpected message, RESOURCE_EXHAUSTED if this process lacks the memory, and
  // UNIMPLEMENTED for a header without the requested size or state, or without the frame's own exposure. Must
  // not be called after a failure.
  absl::StatusOr<StreamEvent> read(grpc::ByteBuffer& message, const DueFrame& due);

 private:
  absl::Status check_header(const v1::ResultHeader& header, const DueFrame& due) const;
  absl::StatusOr<StreamEvent> take_header(v1::ResultHeader header, const DueFrame& due);
  absl::StatusOr<StreamEvent> take_failure(const v1::FrameFailure& failure, const DueFrame& due) const;
  absl::StatusOr<StreamEvent> take_part(const std::string& part);
  FrameAnswer answer();

  const StreamRequested requested_;
  bool opened_ = false;
  bool inside_ = false;  // a result has begun
  RenderResult result_;
  IncomingBands image_{v1::kStreamImageBand};
  size_t encoded_ = 0;  // bytes of the encoded file received so far
};

}  // namespace candela
