#include "client/call/result_reader.h"

#include <span>
#include <utility>

#include "proto/candela/v1/message_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/base/status_macros.h"

namespace candela {

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

}  // namespace candela
