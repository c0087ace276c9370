// An OpenEXR file that a test writes and reads back.
#pragma once

#include <ImathBox.h>
#include <gtest/gtest.h>

#include <string>

#include "client/image/image.h"
#include "tests/support/files.h"
#include "tests/unit/image/image_support.h"

namespace candela {

class ExrReader : public ::testing::Test {
 protected:
  TemporaryFolder folder_;
  const std::string path_ = folder_.path("in.exr");

  // The file's image. Fails the test if it cannot be read.
  Image read(const ImageLimits& limits = {}) {
    absl::StatusOr<Image> image = read_image(path_, limits);
    EXPECT_TRUE(image.ok()) << image.status();
    return image.ok() ? *std::move(image) : Image{};
  }
  // The error of reading the file, or "read" if there is none.
  std::string error(const ImageLimits& limits = {}) {
    absl::StatusOr<Image> image = read_image(path_, limits);
    return image.ok() ? "read" : image.status().ToString();
  }
};

// Expects that `image` shows `display`: the picture of rgb_channels() inside `data`, and 0 with alpha 0
// outside.
inline void expect_picture(const Image& image, const Imath::Box2i& display, const Imath::Box2i& data,
                           float tolerance = 0) {
  ASSERT_EQ(image.width, static_cast<uint32_t>(display.max.x - display.min.x + 1));
  ASSERT_EQ(image.height, static_cast<uint32_t>(display.max.y - display.min.y + 1));
  for (int y = display.min.y; y <= display.max.y; ++y) {
    for (int x = display.min.x; x <= display.max.x; ++x) {
      const bool inside = data.intersects(Imath::V2i(x, y));
      for (int c = 0; c < 4; ++c) {
        const double expected = !inside ? 0 : c == 3 ? 1 : rgb_value(x, y, c);
        ASSERT_NEAR(component(image, x - display.min.x, y - display.min.y, c), expected, tolerance)
            << "pixel " << x << ", " << y << " component " << c;
      }
    }
  }
}

}  // namespace candela
