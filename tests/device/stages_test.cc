// Each shader against its float64 twin, texture by texture.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "server/render/frame/frame_textures.h"
#include "shaders/reference.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class Stages : public DeviceTest {
 protected:
  void SetUp() override {
    DeviceTest::SetUp();
    if (!device().unified_memory()) GTEST_SKIP() << "levels cannot be read back without unified memory";
  }

  static void expect_level(const FrameMemory& memory, size_t level, const reference::Level& truth,
                           const std::string& what) {
    const LevelSize& size = memory.textures().layout.level_sizes[level];
    ASSERT_EQ(size.width, truth.width) << what;
    ASSERT_EQ(size.height, truth.height) << what;
    double maximum = 0.0;
    for (const reference::Rgb& c : truth.texels) maximum = std::max({maximum, c[0], c[1], c[2]});
    const LevelView drawn(memory.textures(), size, memory.textures().levels[level].buffer());
    double worst = 0.0;
    for (size_t i = 0; i < truth.texels.size(); ++i) {
      const std::array<float, 3> texel = drawn.at(i % size.width, i / size.width);
      for (size_t k = 0; k < 3; ++k) worst = std::max(worst, std::abs(texel[k] - truth.texels[i][k]));
    }
    EXPECT_LE(worst, kBloomBound * maximum) << what << " level " << level << ", maximum " << maximum;
  }
};

constexpr Size kStageSizes[] = {{1, 1},   {1, 7},   {2, 2},     {3, 5},     {8, 3},      {17, 31},
                                {64, 64}, {67, 63}, {129, 127}, {333, 517}, {1000, 501}, {1, 1000}};

// With n levels, the coarsest one still has D_{n-1}: bright_pass wrote it if n is 1, otherwise bloom_down
// did. Level 0 has B_0, which every bloom_up contributed to. So all n together check every level of every
// pass.
TEST_F(Stages, EveryBloomLevelIsItsTwins) {
  for (const Size& size : kStageSizes) {
    const WireFrame frame = natural(size.width, size.height);
    reference::BadCounts bad;
    const reference::Scene scene =
        reference::ingest(frame.pixels, frame.desc.row_bytes(), size.width, size.height,
                          shader::PIXELS_RGBA16F, std::nullopt, reference::Rounding::kHalf, &bad);
    for (bool firefly : {true, false}) {
      std::vector<reference::Level> d = {
          reference::bright_pass(scene, {.threshold = 0.02, .firefly_weights = firefly})};
      for (uint32_t levels = 1; levels <= 6; ++levels) {
        v1::Settings settings;
        *settings.mutable_bloom() = bloom(v1::Bloom::KIND_MIP, 1, 0.02f, 0.5f, levels, firefly);
        ASSERT_OK_AND_ASSIGN(auto rendered, render(frame, settings));
        const size_t count = rendered.memory.textures().levels.size();
        if (!rendered.report.plan.bloom() || count < levels) break;
        if (count > d.size()) d.push_back(reference::bloom_down(d.back()));
        const std::string what = std::to_string(size.width) + "x" + std::to_string(size.height);
        expect_level(rendered.memory, count - 1, d.back(), what);
        reference::Level b = d.back();
        for (size_t level = count - 1; level-- > 0;) {
          b = reference::bloom_up(d[level], b);
          expect_level(rendered.memory, level, b, what);
        }
      }
    }
  }
}

TEST_F(Stages, BloomOfOneBrightTexelSumsToTheStatedGain) {
  // Far from every edge, each filter keeps the sum. So each of n levels adds 4 times D_0's sum at level 0.
  const WireFrame frame = make_frame(512, 512, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t y) -> Texel {
    const float v = (x | 1) == 257 && (y | 1) == 257 ? 1000.0f : 0.0f;
    return {v, v, v, 1};
  });
  for (uint32_t levels = 1; levels <= 5; ++levels) {
    v1::Settings settings;
    *settings.mutable_bloom() = bloom(v1::Bloom::KIND_MIP, 1, 1, 0, levels, true);
    ASSERT_OK_AND_ASSIGN(auto rendered, render(frame, settings));
    const FrameTextures& textures = rendered.memory.textures();
    const LevelView level(textures, textures.layout.level_sizes[0], textures.levels[0].buffer());
    double sum = 0.0;
    for (size_t i = 0; i < 256 * 256; ++i) sum += level.at(i % 256, i / 256)[0];
    EXPECT_NEAR(sum / (999.0 * levels), 1.0, 1e-5) << levels << " levels";
  }
}

}  // namespace
}  // namespace candela::testing
