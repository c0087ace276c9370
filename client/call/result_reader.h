// Results from messages: bands, the result of one frame, and those of a session.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <variant>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/call/shared_memory.h"
#include "client/render_result.h"
#include "client/session.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// The pixels of an image that arrives in bands: its size, its memory, and the error for a server that breaks
// the protocol.

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

// Reads the server's answer to a Render call, message by message.

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

// Reads the server's messages of a session call.

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
