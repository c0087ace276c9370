#include "client/run/picture/file_error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/image/color_interop.h"
#include "client/image/power.h"
#include "client/run/picture/frame_files.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Component k of pixel i, 0 .. 1.
double code_of(const Image& picture, size_t i, size_t k) {
  const std::byte* const at = picture.pixels.data();
  if (picture.format == ImageFormat::kRgba8) return std::to_integer<int>(at[4 * i + k]) / 255.0;
  uint16_t code;
  std::memcpy(&code, at + (4 * i + k) * sizeof code, sizeof code);
  return code / 65535.0;
}

struct Worst {
  double max, at_rank;
};

// The largest error, and that of a rank among them all. Moves the errors.
Worst worst_of(std::vector<float>& errors, size_t rank) {
  const auto at = errors.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(errors.begin(), at, errors.end());
  return {*std::max_element(at, errors.end()), *at};
}

}  // namespace

absl::StatusOr<Image> read_codes(const std::string& path) {
  return read_image(path, default_image_limits(), {.keeps_signal = true});
}

absl::StatusOr<FileError> error_of_file(const std::string& path, const Image& codes, const Image& picture) {
  const size_t pixels = size_t{picture.width} * picture.height;
  if (codes.width != picture.width || codes.height != picture.height ||
      codes.format != ImageFormat::kRgba32f) {
    return absl::InternalError(absl::StrFormat("%s: it was written as %dx%d and read as %dx%d", path,
                                               picture.width, picture.height, codes.width, codes.height));
  }
  std::vector<float> errors;
  errors.reserve(3 * pixels);
  double sum = 0;
  for (size_t i = 0; i < pixels; ++i) {
    if (picture.has_alpha && codes.has_alpha && code_of(picture, i, 3) == 0) continue;
    std::array<float, 4> texel;
    std::memcpy(texel.data(), codes.pixels.data() + i * sizeof texel, sizeof texel);
    for (size_t k = 0; k < 3; ++k) {
      errors.push_back(static_cast<float>(255 * std::abs(double{texel[k]} - code_of(picture, i, k))));
      sum += errors.back();
    }
  }
  if (errors.empty()) return FileError{};
  const auto rank = static_cast<size_t>(static_cast<double>(errors.size() - 1) * 0.999);
  const Worst worst = worst_of(errors, rank);
  return FileError{worst.max, worst.at_rank, sum / static_cast<double>(errors.size())};
}

absl::StatusOr<GainMapError> error_of_gain_map(const std::string& path, const Image& codes,
                                               const GainMapCodes& written) {
  ASSIGN_OR_RETURN(const Image hdr, read_image(path, default_image_limits()));
  const GainMapMetadata& metadata = written.metadata;
  const size_t channels = metadata.one_channel ? 1 : 3;
  const size_t pixels = size_t{hdr.width} * hdr.height;
  if (!hdr.display_light || written.codes.size() != channels * pixels) {
    return absl::InternalError(absl::StrFormat("%s: it was written with a gain map and read without", path));
  }
  const auto* const light = reinterpret_cast<const float*>(hdr.pixels.data());
  const auto* const code = reinterpret_cast<const float*>(codes.pixels.data());
  std::vector<float> errors;
  errors.reserve(3 * pixels);
  for (size_t i = 0; i < pixels; ++i) {
    for (size_t c = 0; c < 3; ++c) {
      const size_t k = channels == 1 ? 0 : c;
      const double sdr = to_linear(ColorCurve::kSrgb, code[4 * i + c]) + metadata.offset_sdr[k];
      const double shown = light[4 * i + c] + metadata.offset_hdr[k];
      if (sdr <= 0 || shown <= 0) continue;  // black, which has any gain
      const double gain = metadata.min_log2[k] + (metadata.max_log2[k] - metadata.min_log2[k]) *
                                                     written.codes[channels * i + k] / 255;
      errors.push_back(static_cast<float>(std::abs(log2_of(shown / sdr) - gain)));
    }
  }
  if (errors.empty()) return GainMapError{};
  const Worst worst = worst_of(errors, (errors.size() - 1) * 99 / 100);
  return GainMapError{worst.max, worst.at_rank};
}

}  // namespace candela
