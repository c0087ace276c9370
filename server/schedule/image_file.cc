#include "server/schedule/image_file.h"

#include "server/encode/picture.h"

namespace candela {
namespace {

// Whether images that are rendered with these settings have the frame's alpha, as the client's keeps_alpha().
bool keeps_alpha(const Settings& settings) {
  return settings->alpha() != v1::ALPHA_OVER && settings->alpha() != v1::ALPHA_IGNORE;
}

EncodedTransfer encoded_transfer(v1::Transfer transfer) {
  return transfer == v1::TRANSFER_SRGB      ? EncodedTransfer::kSrgb
         : transfer == v1::TRANSFER_GAMMA22 ? EncodedTransfer::kGamma22
                                            : EncodedTransfer::kLinear;
}

}  // namespace

absl::StatusOr<std::string> encode_image(const FrameMemory& memory, const Settings& settings,
                                         bool opaque, v1::Encoding encoding, int quality) {
  const FrameDesc& desc = memory.desc();
  const std::byte* rows = memory.output_row(0).data();
  const PictureView picture{.width = desc.width,
                            .height = desc.height,
                            .wide = settings->output_format() == v1::OUTPUT_FORMAT_RGBA16,
                            .rows = rows,
                            .row_stride_bytes = static_cast<size_t>(memory.output_row(1).data() - rows)};
  std::string file;
  const auto append = [&file](const void* bytes, size_t count) {
    file.append(static_cast<const char*>(bytes), count);
    return true;
  };
  // A view's values are in its own encoding.
  const EncodedTransfer transfer = settings->curve() == v1::TONE_CURVE_TABLE
                                       ? EncodedTransfer::kUnknown
                                       : encoded_transfer(output_transfer(*settings));
  absl::Status status;
  if (encoding == v1::ENCODING_JPEG) {
    status = encode_jpeg(picture, {quality, transfer}, append);
  } else {
    status = encode_png(picture, {!opaque && keeps_alpha(settings), transfer}, append);
  }
  if (!status.ok()) return status;
  file.shrink_to_fit();  // it may wait for a slow client
  return file;
}

}  // namespace candela
