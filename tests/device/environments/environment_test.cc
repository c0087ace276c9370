// Environments on the device against their float64 twins: the stored panorama, cube maps, irradiance
// and the BRDF table.
#include <half.h>

#include <numbers>

#include "server/base/slices.h"
#include "tests/device/environments/environment_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr std::array<float, 9> kMatrix = {0.9f, 0.2f, -0.1f, -0.3f, 1.1f, 0.2f, 0.05f, -0.15f, 1.1f};

INSTANTIATE_TEST_SUITE_P(Memory, EnvironmentTest, ::testing::Bool(),
                         [](const auto& staging) { return staging.param ? "Staging" : "Unified"; });

constexpr Size kPanoramaSizes[] = {{1, 1}, {2, 1}, {3, 2}, {1, 64}, {97, 41}, {512, 256}};

// NaN, infinities, huge and negative values and a negative zero among ordinary ones.
WireFrame damaged(const Size& size, v1::PixelFormat format) {
  return make_frame(size.width, size.height, format, [](uint32_t x, uint32_t y) -> Texel {
    const float bad[] = {NAN, -NAN, INFINITY, -INFINITY, 1e9f, -1e9f, -0.0f, -1e-7f, 65504.0f, 0.25f};
    const uint32_t k = 7 * x + 3 * y;
    return {bad[k % 10], noise(x, y, 1), k % 3 ? 2.0f : bad[(k / 3) % 10], k % 5 ? 1.0f : NAN};
  });
}

std::vector<WireFrame> panoramas() {
  std::vector<WireFrame> frames = suns();
  for (const Size& size : kPanoramaSizes) frames.push_back(natural(size.width, size.height));
  return frames;
}

// Each texel of `is` within 2^-10 of what `bound` says are the largest texels that it uses.
void expect_level(const reference::CubeLevel& is, const reference::CubeLevel& should,
                  const reference::CubeLevel& bound, const std::string& what) {
  ASSERT_EQ(is.texels.size(), should.texels.size()) << what;
  double worst = 0;
  for (size_t i = 0; i < is.texels.size(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      const double error = std::abs(is.texels[i][k] - should.texels[i][k]);
      ASSERT_LE(error, bound.texels[i][0] / 1024) << what << " texel " << i;
      worst = std::max(worst, bound.texels[i][0] > 0 ? error / bound.texels[i][0] : 0.0);
    }
  }
  ::testing::Test::RecordProperty(what, std::to_string(worst));
}

TEST_P(EnvironmentTest, TheStoredPanoramaIsTheIngestedFrameBitForBit) {
  for (const v1::PixelFormat format :
       {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
    for (const Size& size : kPanoramaSizes) {
      for (const auto& matrix : {std::optional<std::array<float, 9>>(), std::optional(kMatrix)}) {
        const WireFrame frame = damaged(size, format);
        reference::BadCounts counts;
        const reference::Scene scene = scene_of(frame, matrix, &counts);
        const Environment environment = environment_of(baker(), frame, matrix);
        ASSERT_OK_AND_ASSIGN(const auto stored, baker().read_panorama(environment));
        ASSERT_EQ(stored.size(), scene.texels.size());
        for (size_t i = 0; i < scene.texels.size(); ++i) {
          for (size_t k = 0; k < 3; ++k) {
            ASSERT_EQ(stored[i][k], scene.texels[i][k])
                << name_of(frame) << " format " << format << " texel " << i;
          }
        }
        EXPECT_EQ(environment.bad.nan, counts.nan);
        EXPECT_EQ(environment.bad.infinite, counts.infinite);
        EXPECT_EQ(environment.bad.negative, counts.negative);
        EXPECT_EQ(environment.bad.clamped, counts.clamped);
        EXPECT_EQ(environment.bad.first_bad_texel, counts.first_bad_texel);
      }
    }
  }
}

TEST_P(EnvironmentTest, EveryLevelOfTheChainIsItsTwins) {
  for (const WireFrame& frame : panoramas()) {
    const reference::Scene scene = scene_of(frame);
    const Environment environment = environment_of(baker(), frame);
    for (const double rotation_deg : {0.0, 217.0}) {
      const BakedCube cube = bake(environment, {.rotation_deg = rotation_deg, .quality = {4, 0}});
      const uint32_t samples = cube_samples(scene.width, cube.chain.size, 4);
      const auto should =
          reference::cube_chain(reference::cube_face(scene, cube.chain.size, samples, rotation_deg));
      const auto bound = reference::cube_chain(
          reference::cube_face(bound_of(scene), cube.chain.size, samples, rotation_deg));
      ASSERT_EQ(cube.chain.levels, should.size());
      for (uint32_t level = 0; level < cube.chain.levels; ++level) {
        expect_level(level_of(baker(), cube.chain, level), should[level], bound[level],
                     name_of(frame) + " level " + std::to_string(level));
      }
    }
  }
}

TEST_P(EnvironmentTest, MoreSamplesAndLargerLevelsAreTheTwins) {
  const WireFrame frame = natural(97, 41);
  const reference::Scene scene = scene_of(frame);
  const Environment environment = environment_of(baker(), frame);
  for (const uint32_t size : {16u, 64u}) {
    const BakedCube cube = bake(environment, {.size = size, .rotation_deg = -30, .quality = {16, 0}});
    EXPECT_EQ(cube.chain.size, std::max(size, 32u));
    EXPECT_EQ(cube.chain.size_of(cube.first), size);
    const auto should = reference::cube_chain(reference::cube_face(scene, cube.chain.size, 16, -30));
    const auto bound = reference::cube_chain(reference::cube_face(bound_of(scene), cube.chain.size, 16, -30));
    expect_level(level_of(baker(), cube.chain, cube.first), should[cube.first], bound[cube.first], "N");
  }
}

TEST_P(EnvironmentTest, TheHarmonicsAreTheTwins) {
  for (const WireFrame& frame : panoramas()) {
    const reference::Scene scene = scene_of(frame);
    Environment environment = environment_of(baker(), frame);
    ASSERT_OK_AND_ASSIGN(const Harmonics radiance, baker().radiance(environment));
    const reference::Harmonics should = reference::panorama_sh(scene);
    for (const double rotation_deg : {0.0, 77.0}) {
      const Harmonics is = turned(radiance, rotation_deg);
      const reference::Harmonics turned_should = reference::turned(should, rotation_deg);
      for (size_t i = 0; i < 9; ++i) {
        for (size_t k = 0; k < 3; ++k) {
          EXPECT_NEAR(is[i][k], turned_should[i][k], 1e-6 * std::abs(should[0][k]) + 1e-12)
              << name_of(frame) << " coefficient " << i;
        }
      }
    }
    const Harmonics irradiance = irradiance_of(radiance);
    const reference::Harmonics irradiance_should = reference::irradiance_of(should);
    for (size_t i = 0; i < 9; ++i) {
      EXPECT_NEAR(irradiance[i][1], irradiance_should[i][1],
                  1e-5 * std::abs(irradiance_should[0][1]) + 1e-12);
    }
  }
}

TEST_P(EnvironmentTest, AConstantStaysThatConstantInEveryLevelAndInTheIrradiance) {
  for (const Size& size : {Size{1, 1}, Size{97, 41}}) {
    Environment environment = environment_of(baker(), flat(size.width, size.height, {0.75f, 1.0f, 3.0f, 1}));
    const BakedCube cube = bake(environment, {.size = 64, .quality = kDraft});
    const auto expect_constant = [&](const CubeLevels& levels) {
      for (const reference::Rgb& texel : texels_of(baker(), levels)) {
        EXPECT_NEAR(texel[0], 0.75, 1e-5);
        EXPECT_NEAR(texel[1], 1.0, 1e-5);
        EXPECT_NEAR(texel[2], 3.0, 4e-5);
      }
    };
    expect_constant(cube.chain);
    expect_constant(cube.specular);
    const Harmonics irradiance = irradiance_of(*baker().radiance(environment));
    EXPECT_NEAR(irradiance[0][1], 2 * std::pow(std::numbers::pi, 1.5), 1e-5);
    for (size_t i = 1; i < 9; ++i) EXPECT_NEAR(irradiance[i][1], 0, 1e-6);
  }
}

TEST_P(EnvironmentTest, BlackStaysBlackInEveryLevelAndInTheIrradiance) {
  for (const Size& size : {Size{1, 1}, Size{97, 41}}) {
    Environment environment = environment_of(baker(), flat(size.width, size.height, {0, 0, 0, 1}));
    for (const BakeQuality& quality : {kDraft, kReference}) {
      const BakedCube cube = bake(environment, {.size = 64, .quality = quality});
      for (const CubeLevels* levels : {&cube.chain, &cube.specular}) {
        for (const reference::Rgb& texel : texels_of(baker(), *levels)) ASSERT_EQ(texel, reference::Rgb{});
      }
    }
    const Harmonics radiance = *baker().radiance(environment);
    for (const auto& coefficient : radiance) {
      for (const double component : coefficient) EXPECT_EQ(component, 0);
    }
  }
}

TEST_P(EnvironmentTest, TwoBakesHaveTheSameBits) {
  const WireFrame frame = natural(97, 41);
  Environment a = environment_of(baker(), frame), b = environment_of(baker(), frame);
  EXPECT_EQ(*baker().radiance(a), *baker().radiance(b));
  const BakedCube one = bake(a, {.quality = kDraft}), two = bake(b, {.quality = kDraft});
  EXPECT_EQ(texels_of(baker(), one.chain), texels_of(baker(), two.chain));
  EXPECT_EQ(texels_of(baker(), one.specular), texels_of(baker(), two.specular));
}

TEST_P(EnvironmentTest, SlicesOfAnyLengthGiveTheSameBits) {
  const Environment environment = environment_of(baker(), natural(512, 256));
  const BakedCube whole = bake(environment, {.quality = kDraft});
  std::optional<BakedCube> sliced;
  int slices = 0;
  SlicedWork work([&] { sliced = bake(environment, {.quality = kDraft}); }, real_clock());
  for (bool ended = false; !ended; ++slices) ended = work.run(absl::ZeroDuration());
  EXPECT_GT(slices, 5);
  EXPECT_EQ(texels_of(baker(), whole.chain), texels_of(baker(), sliced->chain));
  EXPECT_EQ(texels_of(baker(), whole.specular), texels_of(baker(), sliced->specular));
}

TEST_P(EnvironmentTest, WorkThatIsCancelledGivesItsMemoryBack) {
  const Environment environment = environment_of(baker(), natural(512, 256));
  const uint64_t before = machine().pool->counters().bytes_in_use;
  {
    SlicedWork work([&] { (void)baker().bake(environment, {.quality = kReference}); }, real_clock());
    EXPECT_FALSE(work.run(absl::ZeroDuration()));
    EXPECT_GT(machine().pool->counters().bytes_in_use, before);
  }
  EXPECT_EQ(machine().pool->counters().bytes_in_use, before);
  EXPECT_OK(baker().bake(environment, {.quality = {4, 0}}));
}

TEST_P(EnvironmentTest, TheBrdfTableIsTheTwins) {
  ASSERT_OK_AND_ASSIGN(const std::span<const uint16_t> table, baker().brdf_table());
  double worst = 0;
  for (uint32_t y = 0; y < shader::BRDF_SIZE; y += y < 8 ? 1 : 7) {
    for (uint32_t x = 0; x < shader::BRDF_SIZE; x += x < 8 ? 1 : 7) {
      const reference::BrdfSum should =
          reference::brdf_sum((x + 0.5) / shader::BRDF_SIZE, (y + 0.5) / shader::BRDF_SIZE);
      const size_t at = 2 * (size_t{y} * shader::BRDF_SIZE + x);
      const double scale = imath_half_to_float(table[at]) - should.scale;
      const double bias = imath_half_to_float(table[at + 1]) - should.bias;
      EXPECT_LE(std::abs(scale), 1e-3) << "column " << x << " row " << y;
      EXPECT_LE(std::abs(bias), 1e-3) << "column " << x << " row " << y;
      worst = std::max({worst, std::abs(scale), std::abs(bias)});
    }
  }
  std::printf("BRDF table: %.2e\n", worst);
}

TEST_P(EnvironmentTest, WhatCanNeverFitIsRefusedBeforeMemoryIsTaken) {
  TexturePool small(*machine().device, 1 << 20, real_clock());
  ASSERT_OK_AND_ASSIGN(const auto own, EnvironmentBaker::create(*machine().device, small));
  const auto upload = own->take({1024, 512, v1::PIXEL_FORMAT_RGBA16F});
  EXPECT_REFUSED(kResourceExhausted, "1024x512 rgba16f panorama", upload);
  EXPECT_REFUSED(kResourceExhausted, "the memory budget is 1048576", upload);
  const Environment environment = environment_of(*own, flat(16, 8, {1, 1, 1, 1}));
  EXPECT_REFUSED(kResourceExhausted, "a bake of size 4096 needs",
                 own->bake(environment, {.size = 4096, .quality = kDraft}));
  for (const uint32_t size : {1u, 8u, 24u, 8192u})
    EXPECT_REFUSED(kInvalidArgument, "16 .. 4096", own->bake(environment, {.size = size, .quality = kDraft}));
  EXPECT_EQ(small.counters().bytes_in_use, environment.bytes());
}

TEST(CubeLayout, LevelsFollowEachOtherWithoutAnOverlapAndBeginWhereWritesMay) {
  for (uint32_t size = kMinCubeSize; size <= kMaxCubeSize; size *= 2) {
    const CubeLevels cube{{}, size, chain_levels(size)};
    EXPECT_EQ(cube.size_of(cube.levels - 1), 1u);
    for (uint32_t level = 0; level < cube.levels; ++level) {
      EXPECT_EQ(cube.start(level) * kCubeTexelBytes % PipelineCache::kWriteAlignment, 0u);
      if (level == 0) continue;
      EXPECT_GE(cube.start(level), cube.start(level - 1) + cube.level_texels(level - 1));
    }
  }
}

}  // namespace
}  // namespace candela::testing
