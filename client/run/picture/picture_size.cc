#include "client/run/picture/picture_size.h"

#include <cmath>

#include "absl/strings/str_format.h"
#include "client/base/number_words.h"
#include "proto/candela/v1/limits.h"

namespace candela {
namespace {

// How much wider than the frame's the image's pixels are, so that it shows the frame's shape. 1 if only
// rounding to whole pixels changes it.
double squeeze(v1::ImageSize frame, const v1::OutputSize& asked) {
  const double width = asked.width(), height = asked.height();
  if (width == 0 || height == 0 || asked.has_pixel_aspect()) return 1;
  const double aspect = static_cast<double>(frame.width) / frame.height;
  const bool fits = std::fabs(width - height * aspect) <= 0.5 || std::fabs(height - width / aspect) <= 0.5;
  return fits ? 1 : aspect * height / width;
}

}  // namespace

std::string desqueeze(const Image& frame, v1::Settings& settings) {
  const double aspect = frame.pixel_aspect;
  if (aspect == 1) return "--desqueeze changes nothing: the file's pixels are square";
  if (aspect < v1::kPixelAspect.min || aspect > v1::kPixelAspect.max) {
    return absl::StrFormat(
        "--desqueeze changes nothing: the file's pixel aspect of %s is not within %s .. %s",
        in_digits(aspect, 6), in_digits(v1::kPixelAspect.min, 6), in_digits(v1::kPixelAspect.max, 6));
  }
  settings.mutable_output_size()->set_pixel_aspect(aspect);
  return absl::StrFormat("--desqueeze made square pixels of the file's, whose aspect is %s",
                         in_digits(aspect, 6));
}

double image_pixel_aspect(v1::ImageSize frame, double pixel_aspect, const v1::OutputSize& asked) {
  return asked.has_pixel_aspect() ? 1 : pixel_aspect * squeeze(frame, asked);
}

std::string shape_note(v1::ImageSize frame, const v1::OutputSize& asked) {
  const double by = squeeze(frame, asked);
  if (by == 1) return "";
  return absl::StrFormat(
      "--resize %dx%d changes the shape of %dx%d: the image's pixels have %s times the frame's aspect; "
      "--resize %dx keeps the shape",
      asked.width(), asked.height(), frame.width, frame.height, in_digits(by, 4), asked.width());
}

std::string size_words(v1::ImageSize image, v1::ImageSize frame) {
  const std::string words = absl::StrFormat("%dx%d", image.width, image.height);
  return image == frame ? words : absl::StrFormat("%s of %dx%d", words, frame.width, frame.height);
}

}  // namespace candela
