// The host's passes against the device's, and against themselves with other threads and instruction sets.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>

#include "tests/device/host/host_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

struct Kind {
  const char* name;
  void (*change)(v1::Settings&);
};

class HostPasses : public HostTest {
 protected:
  // Throws if it cannot render, which fails only this test.
  static Rendered must_render(Renderer& renderer, const WireFrame& frame, const v1::Settings& settings,
                              const FrameMoment& moment = {}) {
    auto rendered = render_on(renderer, frame, settings, moment);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return *std::move(rendered);
  }
  static Rendered on_host(const WireFrame& frame, const v1::Settings& settings, uint32_t threads = 2) {
    return must_render(renderer_with(ExecutorKind::kHost, threads), frame, settings);
  }
  static Rendered on_device(const WireFrame& frame, const v1::Settings& settings) {
    return must_render(renderer_with(ExecutorKind::kDevice), frame, settings);
  }
  static void expect_within_a_code(uint32_t width, size_t picture, uint32_t format);
};

// A frame with alpha, absent pixels, and colours outside of Rec.709.
WireFrame mixed(uint32_t width, uint32_t height, v1::PixelFormat format) {
  return make_frame(width, height, format, [=](uint32_t x, uint32_t y) -> Texel {
    if ((x + y) % 11 == 3) return {0, 0, 0, 0};
    Texel t = scenes::natural(width, height)(x, y);
    if (x % 7 == 1) t[1] = -0.25f * t[0];
    return t;
  });
}

int code(const std::vector<std::byte>& image, size_t i, bool wide) {
  if (!wide) return std::to_integer<int>(image[i]);
  return std::to_integer<int>(image[2 * i]) | std::to_integer<int>(image[2 * i + 1]) << 8;
}

// The largest difference of two images' codes: 8 bits, or of `wide` images 16.
int difference(const std::vector<std::byte>& a, const std::vector<std::byte>& b, bool wide) {
  int largest = 0;
  for (size_t i = 0; i < a.size() / (wide ? 2 : 1); ++i) {
    largest = std::max(largest, std::abs(code(a, i, wide) - code(b, i, wide)));
  }
  return largest;
}

// The same, of what the components of wide images add to a picture below them: each times its alpha.
double difference_shown(const std::vector<std::byte>& a, const std::vector<std::byte>& b) {
  const auto shown = [](const std::vector<std::byte>& image, size_t i) {
    const double alpha = i % 4 == 3 ? 1 : code(image, i / 4 * 4 + 3, true) / 65535.0;
    return alpha * code(image, i, true);
  };
  double largest = 0;
  for (size_t i = 0; i < a.size() / 2; ++i) largest = std::max(largest, std::abs(shown(a, i) - shown(b, i)));
  return largest;
}

constexpr Kind kPictures[] = {
    {"bright", [](v1::Settings& s) { s.mutable_bloom()->set_threshold(0.05f); }},
    {"draft, dithered",
     [](v1::Settings& s) {
       s.set_tier("draft");
       s.set_dither(true);
       s.mutable_bloom()->set_threshold(0.05f);
     }},
    {"conserve, aces-1",
     [](v1::Settings& s) {
       s.mutable_bloom()->set_kind(v1::Bloom::KIND_CONSERVE);
       s.set_curve(v1::TONE_CURVE_ACES_1);
     }},
    {"gaussian, agx, straight",
     [](v1::Settings& s) {
       s.mutable_bloom()->set_kind(v1::Bloom::KIND_GAUSSIAN);
       s.mutable_bloom()->set_threshold(1.5f);
       s.set_curve(v1::TONE_CURVE_AGX);
       s.set_alpha(v1::ALPHA_STRAIGHT);
     }},
    {"over, gamma22, Rec.2020",
     [](v1::Settings& s) {
       s.set_alpha(v1::ALPHA_OVER);
       s.mutable_background()->set_green(0.5f);
       s.set_transfer(v1::TRANSFER_GAMMA22);
       s.set_input_primaries(v1::PRIMARIES_REC2020);
     }},
};

// `format` chooses the bits of a component and the frame's format.
void HostPasses::expect_within_a_code(uint32_t width, size_t picture, uint32_t format) {
  const uint32_t height = 1 + width * 5 % 67;
  const Kind& kind = kPictures[picture];
  v1::Settings settings;
  kind.change(settings);
  const bool wide = format % 2 == 0;
  settings.set_output_format(wide ? v1::OUTPUT_FORMAT_RGBA16 : v1::OUTPUT_FORMAT_RGBA8);
  const WireFrame frame = mixed(width, height, kFormats[format % 3]);
  const Rendered host = on_host(frame, settings);
  const Rendered device = on_device(frame, settings);
  const std::vector<std::byte> ours = image(host.memory), theirs = image(device.memory);
  // Straight colours are divided by their alpha, and faint ones in 16 bits then differ by more codes.
  if (wide && settings.alpha() == v1::ALPHA_STRAIGHT) {
    EXPECT_LE(difference_shown(ours, theirs), 2) << width << " wide, " << kind.name;
  } else {
    EXPECT_LE(difference(ours, theirs, wide), 1) << width << " wide, " << kind.name;
  }
  EXPECT_EQ(host.report.gamut_cut_components, device.report.gamut_cut_components)
      << width << " wide, " << kind.name;
}

TEST_F(HostPasses, PixelsAreWithinACodeOfTheDevices) {
  // For each combination of kind, bits and format, the driver compiles the device's passes anew.
  for (uint32_t width = 1; width <= 67; ++width) expect_within_a_code(width, width % 5, width % 5);
}

TEST_F(HostPasses, PixelsOfEveryFormatAreWithinACodeOfTheDevices) {
  for (uint32_t width = 1; width <= 67; ++width) expect_within_a_code(width, width % 5, width);
}

TEST_F(HostPasses, ReadNothingBesideTheRows) {
  for (uint32_t width = 1; width <= 67; ++width) {
    for (const Kind& kind : kPictures) {
      v1::Settings message;
      kind.change(message);
      const Settings settings = checked(message);
      const WireFrame frame = mixed(width, 7, kFormats[width % 3]);
      const Rendered plain = on_host(frame, message);
      FrameMemory memory = in_memory(frame, settings);
      ASSERT_OK_AND_ASSIGN(const auto report, renderer_with(ExecutorKind::kHost, 2).render(memory, settings));
      EXPECT_EQ(image(memory), image(plain.memory)) << width << " wide, " << kind.name;
      expect_same_stats(report.stats, plain.report.stats, std::to_string(width));
    }
  }
}

// The same frame's image and statistics, whatever changes in between.
struct Bits {
  std::vector<std::vector<std::byte>> images;
  std::vector<FrameStats> stats;
};

class HostBits : public HostPasses {
 protected:
  static Bits bits(uint32_t threads) {
    Bits all;
    for (const Kind& kind : kPictures) {
      for (const auto& [width, height] : {std::pair{641u, 359u}, {66u, 35u}}) {
        v1::Settings settings;
        kind.change(settings);
        const Rendered rendered = on_host(mixed(width, height, v1::PIXEL_FORMAT_RGBA16F), settings, threads);
        all.images.push_back(image(rendered.memory));
        all.stats.push_back(rendered.report.stats);
      }
    }
    return all;
  }
  static void expect_same(const Bits& a, const Bits& b) {
    EXPECT_EQ(a.images, b.images);
    for (size_t i = 0; i < a.stats.size(); ++i) expect_same_stats(a.stats[i], b.stats[i], std::to_string(i));
  }
};

TEST_F(HostBits, DoNotDependOnTheThreads) {
  const Bits one = bits(1);
  for (const uint32_t threads : {2, 3, 7}) expect_same(one, bits(threads));
}

TEST_F(HostBits, DoNotDependOnTheInstructionSet) {
  const Bits first = bits(2);
  on_each_instruction_set([&](const std::string& name) {
    SCOPED_TRACE(name);
    expect_same(first, bits(2));
  });
}

TEST_F(HostPasses, ASequenceThatChangesSidesKeepsItsExposures) {
  v1::Settings settings;
  std::optional<PreviousExposure> alone;
  std::optional<PreviousExposure> mixed_sides;
  for (uint32_t i = 0; i < 6; ++i) {
    const float light = std::exp2(static_cast<float>(i % 3));
    const WireFrame frame = make_frame(97, 41, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) {
      Texel t = scenes::natural(97, 41)(x, y);
      for (size_t k = 0; k < 3; ++k) t[k] *= light;
      return t;
    });
    const auto next = [&](Renderer& renderer, std::optional<PreviousExposure>& previous) {
      Rendered rendered = must_render(renderer, frame, settings, {.sequence = i, .previous = previous});
      previous = PreviousExposure{rendered.report.exposure, 0.04};
      return rendered;
    };
    const Rendered device = next(renderer_with(ExecutorKind::kDevice), alone);
    const Rendered other =
        next(renderer_with(i % 2 == 0 ? ExecutorKind::kHost : ExecutorKind::kDevice, i % 2 == 0 ? 2 : 0),
             mixed_sides);
    EXPECT_EQ(std::bit_cast<uint64_t>(device.report.exposure),
              std::bit_cast<uint64_t>(other.report.exposure));
    EXPECT_LE(difference(image(device.memory), image(other.memory), false), 1);
  }
}

TEST_F(HostPasses, AreChosenOnACpuAndRefusedWhereTheyCannotBe) {
  EXPECT_EQ(renderer_with(ExecutorKind::kAuto).executor_kind(), ExecutorKind::kHost);
  EXPECT_EQ(renderer_with(ExecutorKind::kDevice).executor_kind(), ExecutorKind::kDevice);
  const WireFrame frame = natural(32, 16);
  EXPECT_TRUE(says(on_host(frame, {}).report.plan.words.back(), "on the host"));
  EXPECT_TRUE(says(on_device(frame, {}).report.plan.words.back(), "on the device"));
  ASSERT_OK_AND_ASSIGN(auto staged, Device::create({.selector = "", .validation = false, .staging = true}));
  TexturePool own_pool(*staged, uint64_t{1} << 30, real_clock());
  const absl::Status refused = Renderer::create(*staged, own_pool, ExecutorKind::kHost).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_NE(std::string(refused.message()).find("is not the host's"), std::string::npos) << refused;
  EXPECT_EQ((*Renderer::create(*staged, own_pool))->executor_kind(), ExecutorKind::kDevice);
}

TEST_F(HostPasses, RenderNothingOnALostDevice) {
  ASSERT_OK_AND_ASSIGN(auto own, Device::create({}));
  TexturePool own_pool(*own, uint64_t{1} << 30, real_clock());
  ASSERT_OK_AND_ASSIGN(auto renderer, Renderer::create(*own, own_pool, ExecutorKind::kHost));
  ASSERT_OK(render_on(*renderer, natural(8, 8), {}));
  own->lose();
  EXPECT_EQ(render_on(*renderer, natural(8, 8), {}).status().code(), absl::StatusCode::kUnavailable);
}

}  // namespace
}  // namespace candela::testing
