#include "server/encode/image_file.h"

#include <optional>

#include "server/base/status_macros.h"
#include "server/encode/gain_map.h"

namespace candela {

bool keeps_alpha(const v1::Settings& settings) {
  return settings.alpha() != v1::ALPHA_OVER && settings.alpha() != v1::ALPHA_IGNORE;
}

EncodedTransfer encoded_transfer(const v1::Settings& settings) {
  if (settings.curve() == v1::TONE_CURVE_TABLE) return EncodedTransfer::kUnknown;
  switch (settings.transfer()) {
    case v1::TRANSFER_GAMMA22:
      return EncodedTransfer::kGamma22;
    case v1::TRANSFER_LINEAR:
      return EncodedTransfer::kLinear;
    case v1::TRANSFER_PQ:
      return EncodedTransfer::kPq;
    case v1::TRANSFER_HLG:
      return EncodedTransfer::kHlg;
    default:
      return EncodedTransfer::kSrgb;
  }
}

HdrDisplay hdr_display(const v1::Settings& settings, double max_light_nits, double mean_light_nits) {
  HdrDisplay display;
  display.p3 = settings.display_primaries() == v1::PRIMARIES_P3_D65;
  if (settings.has_peak_nits()) display.peak_nits = settings.peak_nits();
  display.max_light_nits = max_light_nits;
  display.mean_light_nits = mean_light_nits;
  return display;
}

absl::StatusOr<std::string> encode_image(const PictureView& picture, const v1::Settings& settings,
                                         const ImageFacts& facts, bool opaque, v1::Encoding encoding,
                                         int quality) {
  std::string file;
  const auto append = [&file](const void* bytes, size_t count) {
    file.append(static_cast<const char*>(bytes), count);
    return true;
  };
  const EncodedTransfer transfer = encoded_transfer(settings);
  const std::optional<GainMapCodes> map = gain_map_in_alpha(picture, facts.gain_map_max_log2);
  RETURN_IF_ERROR(
      encoding == v1::ENCODING_JPEG
          ? encode_jpeg(picture,
                        {.quality = quality, .transfer = transfer, .gain_map = map ? &*map : nullptr}, append)
          : encode_png(picture,
                       {.alpha = !opaque && keeps_alpha(settings),
                        .transfer = transfer,
                        .hdr = facts.hdr,
                        .threads = 1},
                       append));
  file.shrink_to_fit();  // it may wait for a slow client
  return file;
}

}  // namespace candela
