#include "client/image/sample.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

float luminance(const Image& image, uint32_t x, uint32_t y) {
  return 0.2126f * component(image, x, y, 0) + 0.7152f * component(image, x, y, 1) +
         0.0722f * component(image, x, y, 2);
}

TEST(Sample, IsTheSameEveryTime) {
  EXPECT_TRUE(same_pixels(*sample_scene(317, 201), *sample_scene(317, 201)));
}

TEST(Sample, IsFiniteAndOpaqueAtEverySize) {
  const std::pair<uint32_t, uint32_t> sizes[] = {{1, 1},   {1, 7},    {7, 1},    {3, 5},
                                                 {64, 36}, {1000, 3}, {2, 2000}, {16384, 1}};
  for (const auto& [width, height] : sizes) {
    ASSERT_OK_AND_ASSIGN(const auto image, sample_scene(width, height));
    EXPECT_FALSE(image.has_alpha);
    for (uint32_t y = 0; y < height; ++y) {
      for (uint32_t x = 0; x < width; ++x) {
        for (int c = 0; c < 3; ++c) {
          const float v = component(image, x, y, c);
          ASSERT_TRUE(v >= 0 && v <= 1e5f)
              << v << " at " << x << ", " << y << " of " << width << "x" << height;
        }
        ASSERT_EQ(component(image, x, y, 3), 1);
      }
    }
  }
}

TEST(Sample, HoldsASunAndDeepShadow) {
  const Image image = *sample_scene(960, 540);
  float brightest = 0;
  int dark = 0;
  for (uint32_t y = 0; y < 480; ++y) {
    for (uint32_t x = 0; x < 960; ++x) {
      brightest = std::max(brightest, component(image, x, y, 0));
      const float l = luminance(image, x, y);
      dark += l > 3e-4f && l < 3e-3f;
    }
  }
  EXPECT_EQ(brightest, 1e5f);
  EXPECT_GT(dark, 960 * 540 / 30);
}

TEST(Sample, HasTheSameLightAtEverySize) {
  const auto mean_log = [](uint32_t width, uint32_t height) {
    const Image image = *sample_scene(width, height);
    double sum = 0;
    for (uint32_t y = 0; y < height; ++y) {
      for (uint32_t x = 0; x < width; ++x) sum += std::log2(std::max(luminance(image, x, y), 1e-4f));
    }
    return sum / width / height;
  };
  const double expected = mean_log(960, 540);
  EXPECT_NEAR(mean_log(320, 180), expected, 0.1);
  EXPECT_NEAR(mean_log(97, 55), expected, 0.2);
}

TEST(Sample, HasAGreyForEveryStop) {
  const Image image = *sample_scene(1700, 1000);
  for (int i = 0; i < 17; ++i) {
    for (int c = 0; c < 3; ++c) EXPECT_EQ(component(image, 50 + 100 * i, 925, c), std::exp2(i - 10.0f));
  }
}

}  // namespace
}  // namespace candela
