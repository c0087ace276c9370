#include "server/encode/image_file.h"

#include "server/base/status_macros.h"

namespace candela {

bool keeps_alpha(const v1::Settings& settings) {
  return settings.alpha() != v1::ALPHA_OVER && settings.alpha() != v1::ALPHA_IGNORE;
}

EncodedTransfer encoded_transfer(const v1::Settings& settings) {
  if (settings.curve() == v1::TONE_CURVE_TABLE) return EncodedTransfer::kUnknown;
  return settings.transfer() == v1::TRANSFER_GAMMA22  ? EncodedTransfer::kGamma22
         : settings.transfer() == v1::TRANSFER_LINEAR ? EncodedTransfer::kLinear
                                                      : EncodedTransfer::kSrgb;
}

absl::StatusOr<std::string> encode_image(const PictureView& picture, const v1::Settings& settings,
                                         bool opaque, v1::Encoding encoding, int quality) {
  std::string file;
  const auto append = [&file](const void* bytes, size_t count) {
    file.append(static_cast<const char*>(bytes), count);
    return true;
  };
  const EncodedTransfer transfer = encoded_transfer(settings);
  RETURN_IF_ERROR(encoding == v1::ENCODING_JPEG
                      ? encode_jpeg(picture, {quality, transfer}, append)
                      : encode_png(picture, {!opaque && keeps_alpha(settings), transfer, {}, {}, 1}, append));
  file.shrink_to_fit();  // it may wait for a slow client
  return file;
}

}  // namespace candela
