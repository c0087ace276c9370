// The frames that a report is measured on: deterministic, the same on every machine.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"

namespace candela {

struct FrameSize {
  double megapixels = 0;  // as asked for
  uint32_t width = 0;
  uint32_t height = 0;
};

// About 16:9 and as near to `megapixels` as whole pixels come; of 1, 2, 8 and 33 the sizes of screens.
FrameSize frame_size(double megapixels);

// The sample scene as halves, its colour clamped to -65504 .. most. Fails as make_image does.
absl::StatusOr<Image> sample_frame(uint32_t width, uint32_t height, float most = 65504.0f);

// The same picture with one NaN in its middle.
absl::StatusOr<Image> with_one_nan(const Image& halves);

// The same picture with five texels of 30000: in about 1 % of the tiles of a frame of 2 megapixels.
absl::StatusOr<Image> with_few_lights(const Image& halves);

// The middle of an image, of at most that many megapixels and of its shape; the image itself if it is no
// larger.
absl::StatusOr<Image> cropped(Image image, double megapixels);

// A frame on which programs like this one fail.
struct HardCase {
  std::string name;
  std::string expected;  // the stated result
  Image frame;
  std::optional<v1::ExposureState> previous;
};
absl::StatusOr<std::vector<HardCase>> hard_cases();

// 256 x 256, every half in turn as the value of R, G and B, row by row.
absl::StatusOr<Image> every_half();

// A light of 1.5 x 1.5 pixels and luminance 500 on 0.01, moved to the right by `eighths` of a pixel; without
// `eighths` the ground alone.
absl::StatusOr<Image> moving_highlight(std::optional<int> eighths);

// Colours to hold one tone curve against another, 256 wide.
struct Chart {
  std::string name;
  Image frame;
};
absl::StatusOr<std::vector<Chart>> color_charts();

}  // namespace candela
