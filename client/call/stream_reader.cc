#include "client/call/stream_reader.h"

#include <google/protobuf/wire_format_lite.h>

#include <cstring>
#include <utility>
#include <vector>

#include "client/call/wire.h"
#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Encoding makes no image larger by more than this.
constexpr uint64_t kEncodedOverhead = 1u << 16;

bool is_band(const grpc::ByteBuffer& message) {
  using google::protobuf::internal::WireFormatLite;
  constexpr uint32_t kTag = WireFormatLite::MakeTag(static_cast<int>(v1::kStreamImageBand.field),
                                                    WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
  std::vector<grpc::Slice> slices;
  if (!message.Dump(&slices).ok()) return false;
  for (const grpc::Slice& slice : slices) {
    if (slice.size() > 0) return *slice.begin() == kTag;
  }
  return false;
}

}  // namespace

absl::StatusOr<StreamEvent> StreamReader::read(grpc::ByteBuffer& message, const DueFrame& due) {
  if (is_band(message)) {
    if (!inside_ || image_.whole()) return not_the_protocol("an unexpected band");
    RETURN_IF_ERROR(image_.take(message));
    if (image_.whole()) return answer();
    return MoreToCome();
  }
  v1::StreamResponse response;
  if (!v1::unpack(message, response)) return not_the_protocol("it cannot be read");
  switch (response.part_case()) {
    case v1::StreamResponse::kOpened:
      if (opened_) return not_the_protocol("it opens twice");
      opened_ = true;
      return std::move(*response.mutable_opened());
    case v1::StreamResponse::kGoAway:
      return std::move(*response.mutable_go_away());
    case v1::StreamResponse::kHeader:
      return take_header(std::move(*response.mutable_header()), due);
    case v1::StreamResponse::kFailure:
      return take_failure(response.failure(), due);
    case v1::StreamResponse::kEncoded:
      return take_part(response.encoded().data());
    default:
      return not_the_protocol("a message of an unknown kind");
  }
}

absl::Status StreamReader::check_header(const v1::ResultHeader& header, const DueFrame& due) const {
  if (!opened_ || inside_) return not_the_protocol("an unexpected header");
  if (due.frame == nullptr || due.frame->sequence != header.sequence()) {
    return not_the_protocol("a result for the wrong frame");
  }
  RETURN_IF_ERROR(check_image_size(header, {due.frame->width, due.frame->height}, due.image));
  if (requested_.image == (header.encoding() == v1::ENCODING_NONE)) {
    return not_the_protocol("the image is not in the session's encoding");
  }
  if (due.frame->exposure && header.exposure() != *due.frame->exposure) {
    return absl::UnimplementedError(
        "the server ignores the exposures of frames, because it is older than this client; update it");
  }
  if (requested_.state && !header.has_state()) {
    return absl::UnimplementedError(
        "the server ignores a session's state, because it is older than this client; update it");
  }
  return absl::OkStatus();
}

absl::StatusOr<StreamEvent> StreamReader::take_header(v1::ResultHeader header, const DueFrame& due) {
  RETURN_IF_ERROR(check_header(header, due));
  if (!requested_.image) {
    result_ = {};
    result_.header = std::move(header);
    return answer();
  }
  const uint64_t pixel_bytes = bytes_per_pixel(header.format());
  if (pixel_bytes == 0) return not_the_protocol("the image's format is unknown");
  const uint64_t raw_bytes = uint64_t{due.image.width} * due.image.height * pixel_bytes;
  if (header.encoded_bytes() > 2 * raw_bytes + kEncodedOverhead) {
    return not_the_protocol("an encoded image is larger than one can be");
  }
  if (header.image_in_memory()) {
    if (due.place.size != raw_bytes || header.encoded_bytes() > 0) {
      return not_the_protocol("an image is in shared memory that was not offered for it");
    }
    result_ = {};
    result_.data = PixelMemory(due.place.bytes.get(), {.owner = due.place.bytes});
    result_.bytes = raw_bytes;
    result_.header = std::move(header);
    return answer();
  }
  inside_ = true;
  result_ = {};
  result_.bytes = header.encoded_bytes() > 0 ? header.encoded_bytes() : raw_bytes;
  RETURN_IF_ERROR(make_room(result_));
  encoded_ = 0;
  if (header.encoded_bytes() == 0) {
    image_.begin({result_.data.get(), result_.bytes}, due.image.width * pixel_bytes,
                 header.alpha_left_out() ? header.format() : v1::OUTPUT_FORMAT_UNSPECIFIED);
  } else {
    image_.begin({}, 0);
  }
  result_.header = std::move(header);
  return MoreToCome();
}

absl::StatusOr<StreamEvent> StreamReader::take_failure(const v1::FrameFailure& failure,
                                                       const DueFrame& due) const {
  if (!opened_ || inside_) return not_the_protocol("an unexpected failure");
  if (due.frame == nullptr || due.frame->sequence != failure.sequence()) {
    return not_the_protocol("a failure for the wrong frame");
  }
  const auto code = static_cast<absl::StatusCode>(failure.code());
  if (code == absl::StatusCode::kOk) return not_the_protocol("a failure with code OK");
  return FrameAnswer{absl::Status(code, failure.message()), {}, failure.resume_token()};
}

absl::StatusOr<StreamEvent> StreamReader::take_part(const std::string& part) {
  if (!inside_ || !image_.empty()) return not_the_protocol("an unexpected part of a file");
  if (part.empty() || part.size() > result_.bytes - encoded_) {
    return not_the_protocol("a part of a file that does not fit");
  }
  std::memcpy(result_.data.get() + encoded_, part.data(), part.size());
  encoded_ += part.size();
  if (encoded_ == result_.bytes) return answer();
  return MoreToCome();
}

FrameAnswer StreamReader::answer() {
  CHECK(opened_ && image_.whole());
  inside_ = false;
  std::string token = std::move(*result_.header.mutable_resume_token());
  result_.header.clear_resume_token();
  return {absl::OkStatus(), std::exchange(result_, {}), std::move(token)};
}

}  // namespace candela
