#include "server/schedule/image_file.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "server/encode/picture.h"

namespace candela {
namespace {

// Whether a PNG needs its alpha. Without straight alpha a constant one says nothing.
template <typename Component>
bool needs_alpha(const PictureView& picture, bool straight) {
  constexpr size_t kComponents = 4;
  const auto alpha = [&](uint32_t x, uint32_t y) {
    Component value;
    std::memcpy(&value, picture.row(y) + (size_t{x} * kComponents + 3) * sizeof value, sizeof value);
    return value;
  };
  const Component first = straight ? std::numeric_limits<Component>::max() : alpha(0, 0);
  for (uint32_t y = 0; y < picture.height; ++y) {
    for (uint32_t x = 0; x < picture.width; ++x) {
      if (alpha(x, y) != first) return true;
    }
  }
  return false;
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
    const bool straight = settings->alpha() == v1::ALPHA_STRAIGHT;
    const bool alpha =
        picture.wide ? needs_alpha<uint16_t>(picture, straight) : needs_alpha<uint8_t>(picture, straight);
    status = encode_png(picture, {alpha, transfer}, append);
  }
  if (!status.ok()) return status;
  return file;
}

}  // namespace candela
