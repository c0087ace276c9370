// Images of another size than their frames, against the float64 twin and by what they look like.
#include <gtest/gtest.h>
#include <half.h>

#include <cmath>
#include <cstring>

#include "proto/candela/v1/settings.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

struct Picture {
  const char* name;
  TexelFunction texel;
};

std::vector<Picture> pictures(uint32_t width, uint32_t height) {
  return {{"natural", scenes::natural(width, height)},
          {"star field",
           [](uint32_t x, uint32_t y) -> Texel {
             if (noise(x, y, 1) < 0.99f) return {0.001f, 0.001f, 0.002f, 1};
             const float light = std::exp2(16 * noise(x, y, 2));
             return {light * 0.9f, light, light * 0.8f, 1};
           }},
          {"checkerboard of 65504",
           [](uint32_t x, uint32_t y) -> Texel {
             const float light = (x + y) % 2 == 0 ? 65504.0f : 0.0f;
             return {light, light, light, 1};
           }},
          {"hair on alpha",
           [](uint32_t x, uint32_t y) -> Texel {
             const float a = (3 * x + y) % 11 == 0 ? 0.25f + 0.75f * noise(x, y, 4) : 0.0f;
             return {0.6f * a, 0.3f * a, 0.1f * a, a};
           }},
          {"wide gamut, with bad values", [](uint32_t x, uint32_t y) -> Texel {
             const float light = 0.5f * noise(x, y, 5);
             if (x == 5 && y == 7) return {NAN, 1e30f, INFINITY, 1};
             return {x % 5 == 0 ? -0.3f * light : light, light, 0.4f * light, 1};
           }}};
}

void ask_for(uint32_t width, uint32_t height, v1::Settings& settings) {
  settings.mutable_output_size()->set_width(width);
  settings.mutable_output_size()->set_height(height);
}

// As it is on the wire: linear light at an exposure of 1, in halves.
v1::Settings plain_light() {
  v1::Settings settings = at_ev(0);
  settings.set_curve(v1::TONE_CURVE_LINEAR);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  settings.mutable_bloom()->set_intensity(0);
  return settings;
}

struct Kind {
  const char* name;
  void (*change)(v1::Settings&);
};
constexpr Kind kKinds[] = {
    {"usual", [](v1::Settings&) {}},
    {"conserve, over, dither",
     [](v1::Settings& s) {
       s.mutable_bloom()->set_kind(v1::Bloom::KIND_CONSERVE);
       s.set_alpha(v1::ALPHA_OVER);
       s.mutable_background()->set_green(0.5f);
       s.set_dither(true);
     }},
    {"gaussian, straight, Rec.2020",
     [](v1::Settings& s) {
       s.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
       s.mutable_bloom()->set_threshold(1.5f);
       s.set_alpha(v1::ALPHA_STRAIGHT);
       s.set_input_primaries(v1::PRIMARIES_REC2020);
     }},
};

class Resized : public DeviceTest {
 protected:
  static Rendered must_render(const WireFrame& frame, const v1::Settings& settings,
                              Verify verify = Verify::kNo) {
    auto rendered = render(frame, settings, {}, verify);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return *std::move(rendered);
  }
};

TEST_F(Resized, IsWithinHalfACodeOfTheTwin) {
  constexpr uint32_t kWidth = 168, kHeight = 120;
  constexpr Size kImages[] = {{21, 15}, {100, 71}, {336, 240}, {211, 40}, {5, 3}, {1, 1}, {168, 60}};
  double worst = 0;
  size_t i = 0;
  for (const Picture& picture : pictures(kWidth, kHeight)) {
    const WireFrame frame = make_frame(
        kWidth, kHeight, i % 2 == 0 ? v1::PIXEL_FORMAT_RGBA16F : v1::PIXEL_FORMAT_RGBA32F, picture.texel);
    for (const Size& size : kImages) {
      const Kind& kind = kKinds[i++ % 3];
      v1::Settings settings;
      kind.change(settings);
      ask_for(size.width, size.height, settings);
      const Rendered rendered = must_render(frame, settings, Verify::kWithMap);
      SCOPED_TRACE(::testing::Message()
                   << picture.name << " to " << size.width << "x" << size.height << ", " << kind.name);
      EXPECT_EQ(rendered.memory.image(), (ImageSize{size.width, size.height}));
      EXPECT_EQ(image(rendered.memory).size(), size_t{size.width} * size.height * 4);
      const Verification& v = rendered.report.verification->rounded;
      EXPECT_LE(v.max_codes, 0.5) << v.worst_x << ", " << v.worst_y;
      EXPECT_LE(v.max_difference, 1);
      EXPECT_EQ(v.components, uint64_t{size.width} * size.height * 3);
      EXPECT_EQ(rendered.report.gamut_cut_components, rendered.report.verification->gamut_cut_components);
      worst = std::max(worst, v.max_codes);
    }
  }
  std::cout << "the largest error is " << worst << " codes\n";
}

TEST_F(Resized, IsExposedAndBloomsAsItsFrame) {
  const WireFrame frame = lit_tiles(400, 300);
  v1::Settings settings;
  const Rendered whole = must_render(frame, settings);
  settings.mutable_output_size()->set_max_side(100);
  const Rendered small = must_render(frame, settings);
  EXPECT_EQ(small.memory.image(), (ImageSize{100, 75}));
  EXPECT_EQ(small.report.exposure, whole.report.exposure);
  EXPECT_EQ(small.report.stats.metered_weight, whole.report.stats.metered_weight);
  EXPECT_EQ(small.report.plan.bloom_steps.size(), whole.report.plan.bloom_steps.size());
}

TEST_F(Resized, ToTheFramesOwnSizeIsNoChange) {
  const WireFrame frame = natural(130, 70);
  const Rendered whole = must_render(frame, {});
  v1::Settings settings;
  settings.mutable_output_size()->set_percent(100);
  const Rendered same = must_render(frame, settings);
  EXPECT_EQ(image(same.memory), image(whole.memory));
  EXPECT_EQ(same.report.plan.words, whole.report.plan.words);
}

// Component 0 of the halves of an image.
float light_at(const std::vector<std::byte>& image, uint32_t width, uint32_t x, uint32_t y, size_t k = 0) {
  uint16_t bits;
  std::memcpy(&bits, &image[((size_t{y} * width + x) * 4 + k) * sizeof bits], sizeof bits);
  return imath_half_to_float(bits);
}

TEST_F(Resized, ByAWholeFactorIsTheMean) {
  const auto texel = [](uint32_t x, uint32_t y) -> Texel {
    return {static_cast<float>(x % 4) / 8 + static_cast<float>(y % 2) / 4, 0, 0, x < 48 ? 1.0f : 0.25f};
  };
  v1::Settings settings = plain_light();
  ask_for(24, 20, settings);
  const auto pixels =
      image(must_render(make_frame(96, 40, v1::PIXEL_FORMAT_RGBA16F, texel), settings).memory);
  for (uint32_t y = 0; y < 20; ++y) {
    for (uint32_t x = 0; x < 24; ++x) {
      ASSERT_EQ(light_at(pixels, 24, x, y), 0.1875f + 0.125f) << x << ", " << y;
      ASSERT_EQ(light_at(pixels, 24, x, y, 3), x < 12 ? 1.0f : 0.25f) << x << ", " << y;
    }
  }
}

TEST_F(Resized, HasNoRingsAroundLights) {
  constexpr float kSky = 0.125f;
  constexpr uint32_t kX = 81, kY = 40;
  const auto star = [](uint32_t x, uint32_t y) -> Texel {
    const float light = x == kX && y == kY ? 60000.0f : kSky;
    return {light, light, light, 1};
  };
  for (const Size& size : {Size{97, 61}, Size{300, 211}, Size{41, 17}}) {
    v1::Settings settings = plain_light();
    ask_for(size.width, size.height, settings);
    const auto pixels =
        image(must_render(make_frame(160, 100, v1::PIXEL_FORMAT_RGBA16F, star), settings).memory);
    // The main lobe on either side, in pixels of the image.
    const double lobe_x = std::max(1.0, size.width / 160.0), lobe_y = std::max(1.0, size.height / 100.0);
    size_t lit = 0;
    for (uint32_t y = 0; y < size.height; ++y) {
      for (uint32_t x = 0; x < size.width; ++x) {
        const bool near = std::abs(x + 0.5 - (kX + 0.5) * size.width / 160) < lobe_x &&
                          std::abs(y + 0.5 - (kY + 0.5) * size.height / 100) < lobe_y;
        const float light = light_at(pixels, size.width, x, y);
        ASSERT_TRUE(near ? light >= kSky : light == kSky) << x << ", " << y << " is " << light;
        lit += near && light > kSky;
      }
    }
    EXPECT_GT(lit, 0u);
  }
}

TEST_F(Resized, ByTheReferenceIsTheTwin) {
  v1::Settings settings;
  settings.set_tier("reference");
  ask_for(50, 61, settings);
  const Rendered rendered = must_render(natural(120, 90), settings, Verify::kYes);
  EXPECT_EQ(rendered.memory.image(), (ImageSize{50, 61}));
  EXPECT_LE(rendered.report.verification->rounded.max_codes, 1e-4);
}

TEST_F(Resized, AnErrorIsPromisedByTheReferenceAlone) {
  v1::Settings settings = at_ev(0);
  settings.set_max_error_codes(1);
  const WireFrame frame = natural(64, 64);
  EXPECT_EQ(must_render(frame, settings).report.tier, "standard");
  settings.mutable_output_size()->set_percent(50);
  EXPECT_EQ(must_render(frame, settings).report.tier, "reference");
  settings.mutable_output_size()->set_percent(100);
  EXPECT_EQ(must_render(frame, settings).report.tier, "standard");
}

TEST_F(Resized, IsRefusedBeforeMemoryIsTaken) {
  v1::Settings settings;
  ask_for(16384, 16384, settings);
  const absl::Status refused = render(natural(8, 8), settings).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_TRUE(says(std::string(refused.message()), "8x8 rgba16f frame with an image of 16384x16384 pixels"))
      << refused;
}

}  // namespace
}  // namespace candela::testing
