#include "client/run/picture/file_error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/str_format.h"
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

}  // namespace

absl::StatusOr<FileError> error_of_file(const std::string& path, const Image& picture) {
  ASSIGN_OR_RETURN(const Image file, read_image(path, default_image_limits(), {.keeps_signal = true}));
  const size_t pixels = size_t{picture.width} * picture.height;
  if (file.width != picture.width || file.height != picture.height || file.format != ImageFormat::kRgba32f) {
    return absl::InternalError(absl::StrFormat("%s: it was written as %dx%d and read as %dx%d", path,
                                               picture.width, picture.height, file.width, file.height));
  }
  std::vector<float> errors;
  errors.reserve(3 * pixels);
  double sum = 0;
  for (size_t i = 0; i < pixels; ++i) {
    if (picture.has_alpha && file.has_alpha && code_of(picture, i, 3) == 0) continue;
    std::array<float, 4> texel;
    std::memcpy(texel.data(), file.pixels.data() + i * sizeof texel, sizeof texel);
    for (size_t k = 0; k < 3; ++k) {
      errors.push_back(static_cast<float>(255 * std::abs(double{texel[k]} - code_of(picture, i, k))));
      sum += errors.back();
    }
  }
  if (errors.empty()) return FileError{};
  const auto rank = static_cast<size_t>(static_cast<double>(errors.size() - 1) * 0.999);
  std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(rank), errors.end());
  return FileError{*std::max_element(errors.begin() + static_cast<std::ptrdiff_t>(rank), errors.end()),
                   errors[rank], sum / static_cast<double>(errors.size())};
}

}  // namespace candela
