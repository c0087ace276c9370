#include "client/call/incoming_bands.h"

#include <string>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "proto/candela/v1/alpha.h"
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

}  // namespace candela
