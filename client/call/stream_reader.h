// The server's side of a session as its messages arrive.
#pragma once

#include <grpcpp/support/byte_buffer.h>

#include <cstdint>
#include <string>
#include <variant>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/call/incoming_bands.h"
#include "client/render_result.h"
#include "client/session.h"

namespace candela {

// What a message came to.
struct MoreToCome {};  // a part of a result
struct FrameAnswer {
  absl::Status status;
  RenderResult image;
  std::string token;
};
using StreamEvent = std::variant<MoreToCome, v1::StreamOpened, FrameAnswer, v1::GoAway>;

// Of one call. One thread at a time.
class StreamReader {
 public:
  // Takes the next message. `due` is the frame whose result comes next, or null when none is owed; the same
  // one until it has its answer. not_the_protocol for any other message that is not due; nothing is to be
  // read after a failure.
  absl::StatusOr<StreamEvent> read(grpc::ByteBuffer& message, const SessionFrame* due);

 private:
  absl::StatusOr<StreamEvent> take_header(v1::ResultHeader header, const SessionFrame* due);
  absl::StatusOr<StreamEvent> take_failure(const v1::FrameFailure& failure, const SessionFrame* due) const;
  absl::StatusOr<StreamEvent> take_part(const std::string& part);
  FrameAnswer answer();

  bool opened_ = false;
  bool inside_ = false;  // a result has begun
  RenderResult result_;
  IncomingBands image_{v1::kStreamImageBand};
  size_t encoded_ = 0;  // bytes of the file so far
};

}  // namespace candela
