#include "server/render/settings/output_size.h"

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"

namespace candela {

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
  return v1::image_size(settings.output_size(), {desc.width, desc.height});
}

bool resizes(const v1::Settings& settings, const FrameDesc& desc) {
  return image_size(settings, desc) != ImageSize{desc.width, desc.height};
}

}  // namespace candela
