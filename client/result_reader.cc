#include "client/result_reader.h"

#include <grpcpp/support/proto_buffer_reader.h>

#include <string>
#include <utility>

#include "absl/strings/str_format.h"

namespace candela {
namespace {

uint64_t bytes_per_pixel(v1::OutputFormat format) {
  switch (format) {
    case v1::OUTPUT_FORMAT_RGBA8:
      return 4;
    case v1::OUTPUT_FORMAT_RGBA16:
    case v1::OUTPUT_FORMAT_RGBA16F:
      return 8;
    default:
      return 0;
  }
}

}  // namespace

absl::Status not_the_protocol(const char* what) {
  return absl::InternalError(absl::StrFormat("server's answer is not what render.proto says: %s", what));
}

absl::Status ResultReader::read(grpc::ByteBuffer& message) {
  if (result_.data == nullptr) return take_header(message);
  return take_band(message, !image_.whole() || map_.bytes.empty() ? image_ : map_);
}

absl::Status ResultReader::take_header(grpc::ByteBuffer& message) {
  v1::RenderResponse response;
  grpc::ProtoBufferReader slices(&message);
  if (!response.ParseFromZeroCopyStream(&slices) || !response.has_header()) {
    return not_the_protocol("no header comes first");
  }
  const auto [width, height, verify, error_map] = request_;
  result_.header = std::move(*response.mutable_header());
  if (result_.header.width() != width || result_.header.height() != height) {
    return not_the_protocol("the image is not of the frame's size");
  }
  const uint64_t pixel_bytes = bytes_per_pixel(result_.header.format());
  if (pixel_bytes == 0) return not_the_protocol("the image's format is unknown");
  if (verify && !result_.header.has_verify()) {
    return absl::UnimplementedError(
        "the server does not verify frames: it is older than this client; do without verification or update "
        "it");
  }
  result_.bytes = uint64_t{width} * height * pixel_bytes;
  result_.data = std::make_unique_for_overwrite<std::byte[]>(result_.bytes);
  image_.bytes = {result_.data.get(), result_.bytes};
  image_.row_bytes = width * pixel_bytes;
  if (error_map) {
    result_.error_map.resize(size_t{width} * height);
    map_.bytes = std::as_writable_bytes(std::span(result_.error_map));
    map_.row_bytes = width * sizeof(uint16_t);
  }
  return absl::OkStatus();
}

absl::Status ResultReader::take_band(grpc::ByteBuffer& message, Incoming& incoming) {
  uint64_t taken = 0;
  const auto take = [&](google::protobuf::io::CodedInputStream& input, uint64_t bytes) -> absl::Status {
    if (bytes > incoming.bytes.size() - incoming.at) {
      return not_the_protocol("it holds more than the frame has");
    }
    if (!input.ReadRaw(incoming.bytes.data() + incoming.at, static_cast<int>(bytes))) {
      return not_the_protocol("cut short");
    }
    taken = bytes;
    return absl::OkStatus();
  };
  const absl::StatusOr<uint32_t> first_row = v1::read_band(incoming.kind, message, take);
  if (!first_row.ok()) return not_the_protocol(std::string(first_row.status().message()).c_str());
  if (taken == 0) return not_the_protocol("an empty band");
  if (*first_row * incoming.row_bytes != incoming.at) return not_the_protocol("its bands are out of order");
  incoming.at += taken;
  return absl::OkStatus();
}

absl::StatusOr<RenderResult> ResultReader::take() {
  if (result_.data == nullptr || !image_.whole()) {
    return not_the_protocol("it ended before the image was whole");
  }
  if (!map_.whole()) return not_the_protocol("it ended before the error map was whole");
  return std::move(result_);
}

}  // namespace candela
