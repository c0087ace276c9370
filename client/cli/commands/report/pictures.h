// Pictures scaled down for the report's page.
#pragma once

#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

// The largest width, in pixels. Pictures that are no wider keep their size.
inline constexpr uint32_t kPageWidth = 480;

// Scales a picture down. Each pixel of the result, a kRgba8 image, is the mean of the pixels that it covers.
absl::StatusOr<Image> small_picture(std::span<const std::byte> rgba8, uint32_t width, uint32_t height);

// Scales an error map (halves, in codes) down and draws it with its legend. Each pixel shows the largest
// error of those that it covers.
absl::StatusOr<Image> small_error_map(std::span<const uint16_t> halves, uint32_t width, uint32_t height);

}  // namespace candela
