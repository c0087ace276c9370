// Pictures small enough to stand in a page.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

// At most this wide; pictures that are no wider stay as they are.
inline constexpr uint32_t kPageWidth = 480;  // pixels

// A kRgba8 picture, each pixel the mean of those it stands for.
absl::StatusOr<Image> small_picture(std::span<const std::byte> rgba8, uint32_t width, uint32_t height);

// An error map (halves, in codes) drawn with its legend, each pixel the worst of those it stands for.
absl::StatusOr<Image> small_error_map(std::span<const uint16_t> halves, uint32_t width, uint32_t height);

// A kRgba8 picture as a PNG file in base64. Needs a file in `folder` for a moment; fails as write_image does.
absl::StatusOr<std::string> png_base64(const Image& picture, const std::string& folder);

}  // namespace candela
