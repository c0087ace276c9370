// The size of the image that is made of a frame.
#include <gtest/gtest.h>

#include <limits>

#include "proto/candela/v1/limits.h"
#include "server/render/settings/settings.h"
#include "tests/support/status.h"

namespace candela {
namespace {

struct Asked {
  uint32_t width = 0;
  uint32_t height = 0;
  double percent = 0;
  uint32_t max_side = 0;
  double pixel_aspect = 0;
};

v1::Settings settings_of(const Asked& asked) {
  v1::Settings settings;
  v1::OutputSize& size = *settings.mutable_output_size();
  size.set_width(asked.width);
  size.set_height(asked.height);
  if (asked.percent != 0) size.set_percent(asked.percent);
  size.set_max_side(asked.max_side);
  if (asked.pixel_aspect != 0) size.set_pixel_aspect(asked.pixel_aspect);
  return settings;
}

ImageSize made(const Asked& asked, uint32_t width = 1920, uint32_t height = 1080) {
  return image_size(settings_of(asked), {width, height, v1::PIXEL_FORMAT_RGBA16F});
}

TEST(OutputSize, FollowsFromTheFramesShape) {
  EXPECT_EQ(image_size({}, {1920, 1080, v1::PIXEL_FORMAT_RGBA16F}), (ImageSize{1920, 1080}));
  EXPECT_EQ(made({}), (ImageSize{1920, 1080}));
  EXPECT_EQ(made({.width = 1000}), (ImageSize{1000, 563}));  // 562.5
  EXPECT_EQ(made({.height = 270}), (ImageSize{480, 270}));
  EXPECT_EQ(made({.width = 7, .height = 4000}), (ImageSize{7, 4000}));
  EXPECT_EQ(made({.percent = 12.5}), (ImageSize{240, 135}));
  EXPECT_EQ(made({.percent = 1000}), (ImageSize{19200, 10800}));
  EXPECT_EQ(made({.max_side = 480}), (ImageSize{480, 270}));
  EXPECT_EQ(made({.max_side = 480}, 1080, 1920), (ImageSize{270, 480}));
  EXPECT_EQ(made({.max_side = 1920}), (ImageSize{1920, 1080}));
  EXPECT_EQ(made({.max_side = 4000}), (ImageSize{1920, 1080}));
}

TEST(OutputSize, HasSquarePixels) {
  EXPECT_EQ(made({.pixel_aspect = 2}, 1828, 1556), (ImageSize{3656, 1556}));
  EXPECT_EQ(made({.width = 1000, .pixel_aspect = 2}, 1828, 1556), (ImageSize{1000, 426}));
  EXPECT_EQ(made({.height = 778, .pixel_aspect = 2}, 1828, 1556), (ImageSize{1828, 778}));
  EXPECT_EQ(made({.percent = 50, .pixel_aspect = 2}, 1828, 1556), (ImageSize{1828, 778}));
  EXPECT_EQ(made({.max_side = 1828, .pixel_aspect = 2}, 1828, 1556), (ImageSize{1828, 778}));
  EXPECT_EQ(made({.width = 5, .height = 6, .pixel_aspect = 2}), (ImageSize{5, 6}));
}

TEST(OutputSize, HasAtLeastOnePixelASide) {
  EXPECT_EQ(made({.max_side = 4}, 16384, 1), (ImageSize{4, 1}));
  EXPECT_EQ(made({.percent = 1e-9}), (ImageSize{1, 1}));
  EXPECT_EQ(made({.height = std::numeric_limits<uint32_t>::max()}, 16384, 1),
            (ImageSize{std::numeric_limits<uint32_t>::max(), std::numeric_limits<uint32_t>::max()}));
}

TEST(OutputSize, RefusesWhatIsOutOfItsRangeOrDoesNotGoTogether) {
  const auto refusal = [](const Asked& asked) {
    return std::string(Settings::from(settings_of(asked)).status().message());
  };
  EXPECT_EQ(refusal({.percent = -1}), "output_size.percent is -1; it must be above 0 and at most 1000");
  EXPECT_EQ(refusal({.percent = 1000.5}),
            "output_size.percent is 1000.5; it must be above 0 and at most 1000");
  EXPECT_NE(refusal({.percent = std::numeric_limits<double>::quiet_NaN()}), "");
  EXPECT_EQ(refusal({.pixel_aspect = 17}),
            "output_size.pixel_aspect is 17; it must be between 0.0625 and 16");
  EXPECT_EQ(refusal({.width = 9, .percent = 5}),
            "output_size.percent is 5 and the size is 9x0; give one of them");
  EXPECT_EQ(refusal({.height = 9, .max_side = 5}),
            "output_size.max_side is 5 and there is a width or a height, too; give one of them");
  EXPECT_EQ(refusal({.percent = 9, .max_side = 5}),
            "output_size.max_side is 5 and there is a percent, too; give one of them");
  EXPECT_EQ(refusal({.width = 9, .pixel_aspect = 0.0625}), "");
}

TEST(OutputSize, ASideIsWithinTheServersLimit) {
  const absl::StatusOr<Settings> settings = Settings::from(settings_of({.width = 300}));
  ASSERT_OK(settings);
  const FrameDesc desc = {100, 50, v1::PIXEL_FORMAT_RGBA16F};
  EXPECT_OK(check_settings_for(*settings, desc, 300));
  EXPECT_EQ(
      check_settings_for(*settings, desc, 299),
      absl::ResourceExhaustedError("output_size makes an image of 300x150 pixels of a frame of 100x50, and "
                                   "this server makes at most 299 a side; ask for a smaller one"));
  EXPECT_OK(check_settings_for(settings->for_metering(false), desc, 299));
}

}  // namespace
}  // namespace candela
