#include "server/render/settings/output_size.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"

namespace candela {

namespace {

uint32_t side(double pixels) {
  return static_cast<uint32_t>(std::clamp<double>(std::floor(pixels + 0.5), 1, UINT32_MAX));
}

}  // namespace

absl::Status check_output_size(const v1::OutputSize& size) {
  // Written so that NaN fails.
  if (size.has_percent() && !(size.percent() > 0 && size.percent() <= v1::kMaxOutputPercent)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_size.percent is %g; it must be above 0 and at most %g", size.percent(),
                        v1::kMaxOutputPercent));
  }
  if (size.has_pixel_aspect() &&
      !(size.pixel_aspect() >= v1::kPixelAspect.min && size.pixel_aspect() <= v1::kPixelAspect.max)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_size.pixel_aspect is %g; it must be between %g and %g", size.pixel_aspect(),
                        v1::kPixelAspect.min, v1::kPixelAspect.max));
  }
  const bool sides = size.width() > 0 || size.height() > 0;
  if (sides && size.has_percent()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_size.percent is %g and the size is %dx%d; give one of them", size.percent(),
                        size.width(), size.height()));
  }
  if (size.max_side() > 0 && (sides || size.has_percent())) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_size.max_side is %d and there is a %s, too; give one of them",
                        size.max_side(), sides ? "width or a height" : "percent"));
  }
  return absl::OkStatus();
}

ImageSize image_size(const v1::Settings& settings, const FrameDesc& desc) {
  const v1::OutputSize& size = settings.output_size();
  const double width = size.has_pixel_aspect() ? desc.width * size.pixel_aspect() : desc.width;
  const double height = desc.height;
  if (size.width() > 0 && size.height() > 0) return {size.width(), size.height()};
  if (size.width() > 0) return {size.width(), side(height * size.width() / width)};
  if (size.height() > 0) return {side(width * size.height() / height), size.height()};
  if (size.has_percent()) return {side(width * size.percent() / 100), side(height * size.percent() / 100)};
  const double longer = std::max(width, height);
  if (size.max_side() == 0 || longer <= size.max_side()) return {side(width), side(height)};
  return {side(width * size.max_side() / longer), side(height * size.max_side() / longer)};
}

bool resizes(const v1::Settings& settings, const FrameDesc& desc) {
  return image_size(settings, desc) != ImageSize{desc.width, desc.height};
}

}  // namespace candela
