// The frames that a report renders. They are deterministic and the same on every machine.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"

namespace candela {

struct FrameSize {
  double megapixels = 0;  // as the user gave it
  uint32_t width = 0;
  uint32_t height = 0;
};

// A size of about 16:9 as near to `megapixels` as possible. 2, 8
// and 33 give 1920x1080, 3840x2160 and 7680x4320.
FrameSize frame_size(double megapixels);

// The sample scene as halves, with its colour clamped to -65504 .. most. Fails as make_image does.
absl::StatusOr<Image> sample_frame(uint32_t width, uint32_t height, float most = 65504.0f);

// A copy of the picture with one NaN in its middle.
absl::StatusOr<Image> with_one_nan(const Image& halves);

// A copy of the picture with five texels of 30000. They touch about 1 % of the tiles of a 2-megapixel frame.
absl::StatusOr<Image> with_few_lights(const Image& halves);

// Crops the middle out of an image, with its shape and at most
// `megapixels`. Returns the image itself if it is not larger.
absl::StatusOr<Image> cropped(Image image, double megapixels);

// A frame on which image pipelines often fail.
struct HardCase {
  std::string name;
  std::string expected;  // the result that docs/pipeline.md states
  Image frame;
  std::optional<v1::ExposureState> previous;
};
absl::StatusOr<std::vector<HardCase>> hard_cases();

// A 256 x 256 image with every half as the value of R, G and B, row by row.
absl::StatusOr<Image> every_half();

// A light of 1.5 x 1.5 pixels and luminance 500 on a background of 0.01, moved right by `eighths` of a pixel.
// Without `eighths`, only the background.
absl::StatusOr<Image> moving_highlight(std::optional<int> eighths);

// A chart of colours, 256 wide, for comparing tone curves.
struct Chart {
  std::string name;
  Image frame;
};
absl::StatusOr<std::vector<Chart>> color_charts();

// Pictures scaled down for the report's page.

// The largest width, in pixels. Pictures that are no wider keep their size.
inline constexpr uint32_t kPageWidth = 480;

// Scales a picture down. Each pixel of the result, a kRgba8 image, is the mean of the pixels that it covers.
absl::StatusOr<Image> small_picture(std::span<const std::byte> rgba8, uint32_t width, uint32_t height);

// Scales an error map (halves, in codes) down and draws it with its legend. Each pixel shows the largest
// error of those that it covers.
absl::StatusOr<Image> small_error_map(std::span<const uint16_t> halves, uint32_t width, uint32_t height);

}  // namespace candela
