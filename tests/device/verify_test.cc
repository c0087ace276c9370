// Verification finds an image's errors, their places and their sizes.
#include "server/render/reference/verify.h"

#include <gtest/gtest.h>
#include <half.h>

#include <cmath>
#include <cstring>

#include "proto/candela/v1/settings.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/self_test.h"
#include "server/vulkan/device.h"
#include "server/vulkan/functions.h"
#include "tests/support/device_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

class Verified : public DeviceTest {
 protected:
  void SetUp() override {
    DeviceTest::SetUp();
    if (!device().unified_memory()) GTEST_SKIP() << "textures cannot be broken without unified memory";
  }

  static Rendered must_render(const WireFrame& frame, const v1::Settings& settings = {}) {
    absl::StatusOr<Rendered> rendered = render(frame, settings, {}, Verify::kWithMap);
    EXPECT_OK(rendered);
    return *std::move(rendered);
  }

  static Verification again(Rendered& rendered) {
    return verify_frame(rendered.memory, rendered.report.plan, rendered.report.stats).rounded;
  }

  // Component k of a texel of the unquantised image, for a test to change.
  static void set_exact(const Rendered& rendered, uint32_t x, uint32_t y, size_t k, float value) {
    const FrameTextures& textures = rendered.memory.textures();
    const size_t index = (size_t{y} * textures.layout.pitch + x) * 4 + k;
    std::memcpy(textures.exact.buffer().mapped() + index * sizeof value, &value, sizeof value);
  }
  static float exact(const Rendered& rendered, uint32_t x, uint32_t y, size_t k) {
    const FrameTextures& textures = rendered.memory.textures();
    float value;
    const size_t index = (size_t{y} * textures.layout.pitch + x) * 4 + k;
    std::memcpy(&value, textures.exact.buffer().mapped() + index * sizeof value, sizeof value);
    return value;
  }
  static float mapped(const Rendered& rendered, uint32_t x, uint32_t y) {
    return imath_half_to_float(rendered.memory.error_map_row(y)[x]);
  }
};

TEST_F(Verified, ARightImageIsRight) {
  for (v1::OutputFormat format :
       {v1::OUTPUT_FORMAT_RGBA8, v1::OUTPUT_FORMAT_RGBA16, v1::OUTPUT_FORMAT_RGBA16F}) {
    v1::Settings settings;
    settings.set_output_format(format);
    const Rendered rendered = must_render(natural(67, 35), settings);
    ASSERT_TRUE(rendered.report.verification);
    const Verification& error = rendered.report.verification->rounded;
    EXPECT_LE(error.max_codes, 4e-4) << v1::word_of(format);
    EXPECT_LE(error.p999_codes, error.max_codes);
    EXPECT_LE(error.mean_codes, error.p999_codes);
    EXPECT_EQ(error.components, 67u * 35u * 3u);
    float worst = 0;
    for (uint32_t y = 0; y < 35; ++y) {
      for (uint32_t x = 0; x < 67; ++x) worst = std::max(worst, mapped(rendered, x, y));
    }
    EXPECT_EQ(mapped(rendered, error.worst_x, error.worst_y), worst);
    EXPECT_NEAR(worst, error.max_codes, 1e-3 * error.max_codes);
  }
}

TEST_F(Verified, OnlyWhereItIsAskedFor) {
  ASSERT_OK_AND_ASSIGN(const auto rendered, render(natural(8, 8), {}));
  EXPECT_FALSE(rendered.report.verification);
  EXPECT_TRUE(rendered.memory.error_map_row(0).empty());
}

TEST_F(Verified, OneWrongTexelIsTheWorstAndOnTheMap) {
  Rendered rendered = must_render(natural(67, 35));
  const float before = exact(rendered, 5, 20, 1);
  set_exact(rendered, 5, 20, 1, before + 2.0f / 255.0f);
  const Verification error = again(rendered);
  EXPECT_NEAR(error.max_codes, 2.0, 1e-3);
  EXPECT_EQ(error.worst_x, 5u);
  EXPECT_EQ(error.worst_y, 20u);
  EXPECT_LE(error.p999_codes, 4e-4);
  EXPECT_NEAR(mapped(rendered, 5, 20), 2.0, 1e-2);
  EXPECT_LE(mapped(rendered, 6, 20), 4e-4);
}

TEST_F(Verified, AThousandthOfTheComponentsMovesP999) {
  Rendered rendered = must_render(natural(67, 35));
  // There are 7035 components, so p99.9 is the ninth largest error.
  for (uint32_t i = 0; i < 9; ++i) {
    const Verification error = again(rendered);
    EXPECT_LE(error.p999_codes, 4e-4) << i;
    set_exact(rendered, 3 * i, 2 * i, i % 3, exact(rendered, 3 * i, 2 * i, i % 3) + 1.0f / 255.0f);
  }
  EXPECT_NEAR(again(rendered).p999_codes, 1.0, 1e-3);
  EXPECT_NEAR(again(rendered).mean_codes, 9.0 / 7035, 1e-4);
}

TEST_F(Verified, ANaNIsTheWorstThereIs) {
  Rendered rendered = must_render(natural(67, 35));
  set_exact(rendered, 60, 30, 2, NAN);
  EXPECT_EQ(again(rendered).max_codes, INFINITY);
  EXPECT_EQ(again(rendered).worst_x, 60u);
  EXPECT_EQ(again(rendered).mean_codes, INFINITY);
  EXPECT_EQ(mapped(rendered, 60, 30), INFINITY);
  for (uint32_t x = 0; x < 9; ++x) set_exact(rendered, x, 0, 0, NAN);
  EXPECT_EQ(again(rendered).p999_codes, INFINITY);
  // Alpha is not compared.
  Rendered other = must_render(natural(67, 35));
  set_exact(other, 60, 30, 3, NAN);
  EXPECT_LE(again(other).max_codes, 4e-4);
}

TEST_F(Verified, DifferingComponentsAreTheFinishedImages) {
  Rendered rendered = must_render(natural(67, 35));
  const Verification before = again(rendered);
  auto* texel = const_cast<std::byte*>(&rendered.memory.output_row(9)[4 * 31]);
  texel[0] = std::byte(std::to_integer<int>(texel[0]) ^ 0x10);
  texel[1] = std::byte(std::to_integer<int>(texel[1]) ^ 0x10);
  texel[3] ^= std::byte{0xff};
  const Verification after = again(rendered);
  EXPECT_NEAR(static_cast<double>(after.differing), static_cast<double>(before.differing) + 2, 1);
  EXPECT_NEAR(after.max_difference, 16, 1);
  EXPECT_EQ(after.max_codes, before.max_codes);
}

TEST_F(Verified, DitherIsNoDifference) {
  for (v1::OutputFormat format : {v1::OUTPUT_FORMAT_RGBA8, v1::OUTPUT_FORMAT_RGBA16}) {
    v1::Settings settings;
    settings.set_output_format(format);
    settings.set_dither(true);
    ASSERT_OK_AND_ASSIGN(auto rendered, render(natural(333, 129), settings,
                                               {.sequence = 7, .previous = std::nullopt}, Verify::kYes));
    const Verification& error = rendered.report.verification->rounded;
    EXPECT_LE(error.max_codes, 4e-4);
    EXPECT_LE(error.max_difference, 1);
    EXPECT_LE(static_cast<double>(error.differing), format == v1::OUTPUT_FORMAT_RGBA8 ? 130 : 12000);
    // The noise of another frame counts as a difference.
    Plan next = rendered.report.plan;
    next.reference.dither_frame = 8;
    const Verification other = verify_frame(rendered.memory, next, rendered.report.stats).rounded;
    EXPECT_GT(static_cast<double>(other.differing), 0.3 * static_cast<double>(other.components));
  }
}

TEST_F(Verified, WrongMeteringAndWrongBloomAreSeen) {
  Rendered rendered = must_render(natural(67, 35));
  EXPECT_LE(again(rendered).meter_error_ev, 2e-5);
  EXPECT_LE(again(rendered).bloom_error, 4e-6);
  rendered.report.stats.mean_log2_luminance += 0.25;
  EXPECT_NEAR(again(rendered).meter_error_ev, 0.25, 2e-5);
  const FrameTextures& textures = rendered.memory.textures();
  std::memset(textures.levels[0].buffer().mapped(), 0, textures.levels[0].buffer().bytes());
  EXPECT_NEAR(again(rendered).bloom_error, 1.0, 1e-9);
  std::memset(textures.levels[0].buffer().mapped(), 0xff, 16);  // NaN
  EXPECT_EQ(again(rendered).bloom_error, INFINITY);
}

TEST_F(Verified, BloomThatStartsCoarserIsHeldAgainstTheWhole) {
  v1::Settings settings;
  settings.set_tier("draft");
  // The light is smooth, so the skipped level hardly matters.
  const WireFrame frame = make_frame(256, 200, v1::PIXEL_FORMAT_RGBA16F, [](uint32_t x, uint32_t y) -> Texel {
    const float dx = static_cast<float>(x) - 128.0f, dy = static_cast<float>(y) - 100.0f;
    const float v = 30.0f * std::exp(-(dx * dx + dy * dy) / 1500.0f);
    return {v, v, v, 1};
  });
  const Verification smooth = must_render(frame, settings).report.verification->rounded;
  EXPECT_GT(smooth.bloom_error, 4e-6);
  EXPECT_LT(smooth.bloom_error, 0.02);
  EXPECT_GT(must_render(natural(256, 200), settings).report.verification->rounded.bloom_error, 0.02);
  // It matches the twin with the same numbers.
  Rendered rendered = must_render(frame, settings);
  EXPECT_LE(verify_frame(rendered.memory, rendered.report.plan, rendered.report.stats, 4).rounded.bloom_error,
            4e-6);
}

// The tier `reference` does not round the scene, so neither of its numbers is of halves.
TEST_F(Verified, TheReferenceReportsTheLuminancesOfTheSceneThatItMeters) {
  constexpr float kDark = 0.1f, kBright = 0.7f;  // neither is a half
  const WireFrame frame = make_frame(67, 35, v1::PIXEL_FORMAT_RGBA32F, [](uint32_t x, uint32_t) -> Texel {
    const float v = x == 5 ? kBright : kDark;
    return {v, v, v, 1};
  });
  v1::Settings settings;
  const FrameReport rounded = must_render(frame, settings).report;
  settings.set_tier("reference");
  const FrameReport exact = must_render(frame, settings).report;
  EXPECT_FLOAT_EQ(exact.stats.min_luminance, kDark);
  EXPECT_FLOAT_EQ(exact.stats.max_luminance, kBright);
  EXPECT_EQ(exact.stats.min_luminance, exact.verification->truth.min_luminance);
  EXPECT_EQ(exact.stats.max_luminance, exact.verification->truth.max_luminance);
  const double mean = (66 * std::log2(double{kDark}) + std::log2(double{kBright})) / 67;
  EXPECT_NEAR(exact.stats.mean_log2_luminance, mean, 1e-6);
  EXPECT_FLOAT_EQ(rounded.stats.max_luminance, imath_half_to_float(imath_float_to_half(kBright)));
  EXPECT_NE(rounded.stats.max_luminance, exact.stats.max_luminance);
}

TEST_F(Verified, WithoutRoundingFloatsAreFurtherOffAndHalvesAreNot) {
  const FrameReport floats = must_render(natural(67, 35, v1::PIXEL_FORMAT_RGBA32F)).report;
  EXPECT_GT(floats.verification->unrounded.max_codes, 10 * floats.verification->rounded.max_codes);
  EXPECT_LT(floats.verification->unrounded.max_codes, 0.5);
  const FrameReport halves = must_render(natural(67, 35)).report;
  EXPECT_EQ(halves.verification->unrounded.max_codes, halves.verification->rounded.max_codes);
  v1::Settings settings;  // with a matrix, scene values are no longer halves
  settings.set_input_primaries(v1::PRIMARIES_REC2020);
  const FrameReport converted = must_render(natural(67, 35), settings).report;
  EXPECT_GT(converted.verification->unrounded.max_codes, 10 * converted.verification->rounded.max_codes);
}

TEST_F(Verified, StagingCopiesChangeNoNumber) {
  ASSERT_OK_AND_ASSIGN(auto staged, Device::create({.selector = "", .validation = false, .staging = true}));
  TexturePool own_pool(*staged, uint64_t{1} << 30, real_clock());
  ASSERT_OK_AND_ASSIGN(auto own, Renderer::create(*staged, own_pool));
  for (const WireFrame& frame : {natural(131, 67), natural(130, 35, v1::PIXEL_FORMAT_RGBA32F)}) {
    ASSERT_OK_AND_ASSIGN(const auto there, render_on(*own, frame, {}, {}, Verify::kWithMap));
    ASSERT_OK_AND_ASSIGN(const auto here,
                         render_on(renderer_with(ExecutorKind::kDevice), frame, {}, {}, Verify::kWithMap));
    const Verification& a = there.report.verification->rounded;
    const Verification& b = here.report.verification->rounded;
    EXPECT_EQ(a.max_codes, b.max_codes);
    EXPECT_EQ(a.mean_codes, b.mean_codes);
    EXPECT_EQ(a.differing, b.differing);
    EXPECT_EQ(a.bloom_error, b.bloom_error);
    EXPECT_GT(a.bloom_error, 0.0);
    EXPECT_EQ(mapped(there, a.worst_x, a.worst_y), mapped(here, b.worst_x, b.worst_y));
  }
}

TEST_F(Verified, TakesItsMemoryFromTheBudgetAndGivesItBack) {
  const FrameDesc desc = {640, 480, v1::PIXEL_FORMAT_RGBA16F};
  constexpr uint64_t kPixels = 640 * 480;
  // Frame, image and levels are 18 bytes a pixel, verification 44 more.
  TexturePool small(device(), 40 * kPixels, real_clock());
  ASSERT_OK_AND_ASSIGN(auto renderer, Renderer::create(device(), small));
  EXPECT_OK(renderer->allocate(desc, {}));
  const absl::Status refused = renderer->allocate(desc, {}, Verify::kYes).status();
  EXPECT_REFUSED(kResourceExhausted, "the memory budget is 12288000", refused);
  EXPECT_TRUE(says(refused.message(), "do without verification"));

  TexturePool enough(device(), 70 * kPixels, real_clock());
  ASSERT_OK_AND_ASSIGN(auto other, Renderer::create(device(), enough));
  ASSERT_OK_AND_ASSIGN(auto memory, other->allocate(desc, {}, Verify::kWithMap));
  EXPECT_GE(enough.counters().bytes_in_use, 58 * kPixels);
  // There is no room now, but there will be.
  EXPECT_EQ(other->allocate(desc, {}, Verify::kYes).status().code(), absl::StatusCode::kUnavailable);
  memory.keep_output_only();
  EXPECT_EQ(enough.counters().bytes_in_use, (4 + 2) * kPixels);
  memory = FrameMemory();
  EXPECT_EQ(enough.counters().bytes_in_use, 0u);
}

// The self-test passes on a correct device and refuses a wrong image.

using SelfTest = DeviceTest;

TEST_F(SelfTest, RendersAFrameAndPasses) {
  const PoolCounters before = pool().counters();
  ASSERT_OK_AND_ASSIGN(const std::string digest, self_test(renderer()));
  const PoolCounters after = pool().counters();
  EXPECT_GT(after.hits + after.misses, before.hits + before.misses);
  EXPECT_EQ(digest.size(), 64u);
  // Also where the memory holds another frame.
  ASSERT_OK_AND_ASSIGN(const auto other, render(natural(131, 37), {}));
  ASSERT_OK_AND_ASSIGN(const std::string again, self_test(renderer()));
  EXPECT_EQ(again, digest);
}

TEST_F(SelfTest, SeesOneWrongPixel) {
  ASSERT_OK_AND_ASSIGN(auto rendered, render(natural(67, 35), {}));
  EXPECT_OK(hold_to_reference(rendered.memory, rendered.report));
  // The device rendered this texel differently from the reference.
  rendered.memory.input_row(20)[5 * 8 + 1] ^= std::byte{0x08};
  const absl::Status status = hold_to_reference(rendered.memory, rendered.report);
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
}

TEST_F(SelfTest, SeesWrongStatistics) {
  ASSERT_OK_AND_ASSIGN(auto rendered, render(natural(67, 35), {}));
  FrameReport metered_wrong = rendered.report;
  metered_wrong.stats.mean_log2_luminance += 1e-4;
  EXPECT_FALSE(hold_to_reference(rendered.memory, metered_wrong).ok());
  FrameReport counted_wrong = rendered.report;
  ++counted_wrong.stats.negative_components;
  EXPECT_FALSE(hold_to_reference(rendered.memory, counted_wrong).ok());
}

}  // namespace
}  // namespace candela::testing

// In a build with CANDELA_VALIDATION, a misuse of Vulkan ends the process that does it.

#ifdef CANDELA_VALIDATION

namespace candela::testing {
namespace {

// A fence with an unknown flag, on a device that nobody asked to validate.
void misuse_vulkan() {
  const absl::StatusOr<std::unique_ptr<Device>> device = Device::create({});
  VkFenceCreateInfo info{};
  info.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO;
  info.flags = 2;
  VkFence fence = VK_NULL_HANDLE;
  if (vkCreateFence((*device)->handle(), &info, nullptr, &fence) == VK_SUCCESS) {
    vkDestroyFence((*device)->handle(), fence, nullptr);
  }
}

TEST(ValidationDeathTest, AMessageEndsTheProcess) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_DEATH(misuse_vulkan(), "vulkan validation: .*flags");
}

}  // namespace
}  // namespace candela::testing

#endif
