#include "server/schedule/image_file.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "server/encode/picture.h"

namespace candela {
namespace {

// Whether a PNG needs its alpha, by the client's rule (write_png): an alpha that is 1 everywhere says
// nothing, and one that is 0 everywhere would hide the whole picture.
template <typename Component>
bool needs_alpha(const PictureView& picture) {
  constexpr size_t kComponents = 4;
  constexpr Component kOpaque = std::numeric_limits<Component>::max();
  bool opaque = true, transparent = true, colour = false;  // everywhere, everywhere, anywhere
  for (uint32_t y = 0; y < picture.height; ++y) {
    for (uint32_t x = 0; x < picture.width; ++x) {
      Component pixel[kComponents];
      std::memcpy(pixel, picture.row(y) + x * sizeof pixel, sizeof pixel);
      opaque = opaque && pixel[3] == kOpaque;
      transparent = transparent && pixel[3] == 0;
      colour = colour || pixel[0] != 0 || pixel[1] != 0 || pixel[2] != 0;
      if (!opaque && !transparent) return true;
    }
  }
  return transparent && !colour;
}

EncodedTransfer encoded_transfer(v1::Transfer transfer) {
  return transfer == v1::TRANSFER_SRGB      ? EncodedTransfer::kSrgb
         : transfer == v1::TRANSFER_GAMMA22 ? EncodedTransfer::kGamma22
                                            : EncodedTransfer::kLinear;
}

}  // namespace

absl::StatusOr<std::string> encode_image(const FrameMemory& memory, const Settings& settings,
                                         v1::Encoding encoding, int quality) {
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
    const bool alpha = picture.wide ? needs_alpha<uint16_t>(picture) : needs_alpha<uint8_t>(picture);
    status = encode_png(picture, {alpha, transfer}, append);
  }
  if (!status.ok()) return status;
  file.shrink_to_fit();  // it may wait for a slow client
  return file;
}

}  // namespace candela
