#include "client/call/result_reader.h"

#include <google/protobuf/wire_format_lite.h>

#include <cstring>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/call/channel.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

absl::Status not_the_protocol(const char* what) {
  return absl::InternalError(absl::StrFormat("server's answer does not follow render.proto: %s", what));
}

absl::Status check_image_size(const v1::ResultHeader& header, v1::ImageSize frame, v1::ImageSize asked) {
  const v1::ImageSize size{header.width(), header.height()};
  if (size == asked) return absl::OkStatus();
  if (size == frame) {
    return absl::UnimplementedError(
        "the server ignores the size of images, because it is older than this client; leave out the size or "
        "update the server");
  }
  return not_the_protocol(absl::StrFormat("the image has %dx%d pixels and not %dx%d", size.width, size.height,
                                          asked.width, asked.height)
                              .c_str());
}

absl::Status make_room(RenderResult& result) {
  result.data = pixels_to_overwrite(result.bytes);
  if (result.data != nullptr) return absl::OkStatus();
  // This process lacks it, and not the server.
  return failure_of(FailureKind::kOther,
                    absl::ResourceExhaustedError(absl::StrFormat(
                        "out of memory for an image of %d bytes; give this process more", result.bytes)));
}

void IncomingBands::begin(std::span<std::byte> bytes, uint64_t row_bytes, v1::OutputFormat left_out) {
  CHECK(bytes.empty() || (row_bytes > 0 && bytes.size() % row_bytes == 0));
  CHECK(whole());  // the image before
  bytes_ = bytes;
  row_bytes_ = row_bytes;
  left_out_ = left_out;
  at_ = 0;
}

// Returns how much of the image they are.
absl::StatusOr<uint64_t> IncomingBands::take_rows(google::protobuf::io::CodedInputStream& input,
                                                  uint64_t bytes) const {
  if (left_out_ == v1::OUTPUT_FORMAT_UNSPECIFIED) {
    if (bytes > bytes_.size() - at_) return not_the_protocol("it holds more than the frame has");
    if (!input.ReadRaw(bytes_.data() + at_, static_cast<int>(bytes))) return not_the_protocol("cut short");
    return bytes;
  }
  std::vector<std::byte> narrow(row_bytes_ / 4 * 3);
  if (bytes % narrow.size() != 0) return not_the_protocol("a band of parts of rows");
  const uint64_t rows = bytes / narrow.size();
  if (rows > (bytes_.size() - at_) / row_bytes_) return not_the_protocol("it holds more than the frame has");
  for (uint64_t y = 0; y < rows; ++y) {
    if (!input.ReadRaw(narrow.data(), static_cast<int>(narrow.size()))) return not_the_protocol("cut short");
    v1::add_alpha(left_out_, narrow, bytes_.subspan(at_ + y * row_bytes_, row_bytes_));
  }
  return rows * row_bytes_;
}

absl::Status IncomingBands::take(grpc::ByteBuffer& message) {
  uint64_t taken = 0;
  const auto take = [&](google::protobuf::io::CodedInputStream& input, uint64_t bytes,
                        v1::BandRows form) -> absl::Status {
    if (form != v1::BandRows::kPixels) return not_the_protocol("a compressed band");
    ASSIGN_OR_RETURN(taken, take_rows(input, bytes));
    return absl::OkStatus();
  };
  const absl::StatusOr<uint32_t> first_row = v1::read_band(kind_, message, take);
  if (!first_row.ok()) return not_the_protocol(std::string(first_row.status().message()).c_str());
  if (taken == 0) return not_the_protocol("an empty band");
  if (*first_row * row_bytes_ != at_) return not_the_protocol("its bands are out of order");
  at_ += taken;
  CHECK(at_ <= bytes_.size());
  return absl::OkStatus();
}

absl::Status ResultReader::read(grpc::ByteBuffer& message) {
  if (result_.data == nullptr) return take_header(message);
  return (!image_.whole() || map_.empty() ? image_ : map_).take(message);
}

absl::Status ResultReader::take_header(grpc::ByteBuffer& message) {
  v1::RenderResponse response;
  if (!v1::unpack(message, response) || !response.has_header()) {
    return not_the_protocol("no header comes first");
  }
  const auto& [frame, image, verify, error_map, exposure] = request_;
  result_.header = std::move(*response.mutable_header());
  RETURN_IF_ERROR(check_image_size(result_.header, frame, image));
  const uint64_t pixel_bytes = bytes_per_pixel(result_.header.format());
  if (pixel_bytes == 0) return not_the_protocol("the image's format is unknown");
  if (verify && !result_.header.has_verify()) {
    return absl::UnimplementedError(
        "the server does not verify frames, because it is older "
        "than this client; leave out verification or update it");
  }
  if (exposure && result_.header.exposure() != *exposure) {
    return absl::UnimplementedError(
        "the server ignores the exposures of frames, because it is older than this client; update it");
  }
  result_.bytes = uint64_t{image.width} * image.height * pixel_bytes;
  RETURN_IF_ERROR(make_room(result_));
  image_.begin({result_.data.get(), result_.bytes}, image.width * pixel_bytes);
  if (error_map) {
    result_.error_map.resize(size_t{image.width} * image.height);
    map_.begin(std::as_writable_bytes(std::span(result_.error_map)), image.width * sizeof(uint16_t));
  }
  return absl::OkStatus();
}

absl::StatusOr<RenderResult> ResultReader::take() {
  if (result_.data == nullptr || !image_.whole()) {
    return not_the_protocol("it ended before the image was whole");
  }
  if (!map_.whole()) return not_the_protocol("it ended before the error map was whole");
  return std::move(result_);
}

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
