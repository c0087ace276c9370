// Rendering bloom only in the area that light reaches changes no bit.
#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class SparseBloom : public DeviceTest {
 protected:
  // The image if every tile counts as lit, so that every pass writes its whole level.
  static std::vector<std::byte> dense(const WireFrame& frame, const v1::Settings& settings) {
    absl::StatusOr<FrameMemory> memory = renderer().allocate(frame.desc, checked(settings));
    EXPECT_OK(memory);
    for (uint32_t y = 0; y < frame.desc.height; ++y) {
      std::copy_n(frame.pixels.begin() + static_cast<std::ptrdiff_t>(y * frame.desc.row_bytes()),
                  frame.desc.row_bytes(), memory->input_row(y).begin());
    }
    absl::StatusOr<Metered> metered = renderer().meter(*memory, checked(settings));
    EXPECT_OK(metered);
    for (float& light : metered->stats.tile_light) light = std::numeric_limits<float>::infinity();
    const Exposed exposed =
        expose(checked(settings)->exposure(), std::nullopt, metered->stats.mean_log2_luminance);
    const auto report = renderer().draw(*memory, checked(settings), 0, *metered, exposed);
    EXPECT_OK(report);
    return image(*memory);
  }

  // If `sparse`, also checks that a part of the frame was left out.
  static void expect_same(const WireFrame& frame, const v1::Settings& settings, bool sparse,
                          const std::string& what) {
    ASSERT_OK_AND_ASSIGN(const auto rendered, render(frame, settings));
    uint64_t lit = 0;
    for (const Box& box : rendered.report.plan.lit) lit += uint64_t{box.x1 - box.x0} * (box.y1 - box.y0);
    EXPECT_EQ(lit < uint64_t{frame.desc.width} * frame.desc.height, sparse) << what;
    EXPECT_EQ(image(rendered.memory), dense(frame, settings)) << what;
  }
};

TEST_F(SparseBloom, IsTheDenseOneWhateverTheKindAndTheTier) {
  const Texel white = {900, 700, 400, 1};
  for (const v1::Bloom::Kind kind :
       {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
    for (const char* tier : {"standard", "draft"}) {
      for (const uint32_t levels : {1u, 2u, 5u, 9u}) {
        v1::Settings settings;
        settings.set_tier(tier);
        settings.mutable_bloom()->set_kind(kind);
        settings.mutable_bloom()->set_levels(levels);
        if (kind == v1::Bloom::KIND_GAUSSIAN) settings.mutable_bloom()->set_threshold(8);
        const std::string what = std::string(tier) + ", " + std::to_string(levels) + " levels of kind " +
                                 std::to_string(static_cast<int>(kind));
        expect_same(lights(1500, 1100, {{700, 500}}, 3, white), settings, kind != v1::Bloom::KIND_CONSERVE,
                    what);
      }
    }
  }
}

TEST_F(SparseBloom, IsTheDenseOneWhereverTheLightsAre) {
  std::mt19937 random(11);
  constexpr std::pair<uint32_t, uint32_t> kSizes[] = {{1920, 1080}, {1283, 719}, {130, 2000}, {2051, 67}};
  for (const auto& [width, height] : kSizes) {
    const std::vector<std::pair<uint32_t, uint32_t>> corners = {
        {0, 0}, {width - 1, 0}, {0, height - 1}, {width - 1, height - 1}};
    for (int round = 0; round < 8; ++round) {
      std::vector<std::pair<uint32_t, uint32_t>> at;
      if (round < 4) {
        at = {corners[static_cast<size_t>(round)]};
      } else {
        for (int i = 4; i <= round; ++i) at.emplace_back(random() % width, random() % height);
      }
      const Texel light = {4000, 4000, 4000, 1};
      expect_same(lights(width, height, at, 1 + round % 3, light), {}, true,
                  std::to_string(width) + "x" + std::to_string(height) + ", round " + std::to_string(round));
    }
  }
}

// A tile counts as dark by its brightest texel, and then no pass may find light in it. This holds at the
// threshold, if a negative component makes the luminance small, if the primaries make components negative,
// and in each format.
TEST_F(SparseBloom, IsTheDenseOneAtTheThreshold) {
  for (const float softness : {0.0f, 0.5f, 1.0f}) {
    for (const float light : {0.499f, 0.5f, 0.501f, 0.9995f, 1.0f, 1.0005f}) {
      v1::Settings settings;
      settings.mutable_bloom()->set_softness(softness);
      const WireFrame frame = lights(700, 500, {{333, 222}}, 40, {light, light, light, 1});
      EXPECT_EQ(image(render(frame, settings)->memory), dense(frame, settings)) << softness << " " << light;
    }
  }
  const std::vector<std::pair<uint32_t, uint32_t>> at = {{333, 222}};
  expect_same(lights(700, 500, at, 9, {-300, -50, 900, 1}), {}, true, "negative components");
  expect_same(lights(700, 500, at, 9, {-300, -50, 900, 1}, v1::PIXEL_FORMAT_RGBA32F), {}, true, "in floats");
  expect_same(lights(700, 500, at, 9, {0, 50, 900, 1}, v1::PIXEL_FORMAT_RGB9E5), {}, true,
              "in shared exponents");
  v1::Settings wide;
  wide.set_input_primaries(v1::PRIMARIES_REC2020);
  expect_same(lights(700, 500, at, 9, {0, 30, 0, 1}), wide, true, "wide primaries");
  expect_same(lights(700, 500, at, 9, {std::numeric_limits<float>::infinity(), 0, 0, 1}), {}, true,
              "infinite");
}

}  // namespace
}  // namespace candela::testing
