// The host's passes, in the device's memory: the same bits.
#include <gtest/gtest.h>

#include <bit>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "server/render/device/device_executor.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/host/host_executor.h"
#include "server/render/host/targets.h"
#include "tests/support/device_fixture.h"
#include "tests/support/settings.h"
// Only after targets.h.
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/render/environment/environment_baker.h"
#include "server/render/host/bloom.h"
#include "shaders/reference.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

constexpr v1::PixelFormat kFormats[] = {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F,
                                        v1::PIXEL_FORMAT_RGB9E5};

class HostTest : public DeviceTest {
 protected:
  void SetUp() override {
    DeviceTest::SetUp();
    if (const std::string why = HostExecutor::unavailable(device().summary()); !why.empty())
      GTEST_SKIP() << why;
  }

  // The frame's own memory, with NaN in the padding of its rows.
  static FrameMemory in_memory(const WireFrame& frame, const Settings& settings) {
    absl::StatusOr<FrameMemory> memory =
        FrameMemory::take(pool(), device().summary(), layout_textures(frame.desc, settings), Verify::kNo);
    if (!memory.ok()) throw std::runtime_error(memory.status().ToString());
    const Buffer& input = memory->textures().input.buffer();
    std::memset(input.mapped(), 0xff, input.bytes());
    for (uint32_t y = 0; y < frame.desc.height; ++y) {
      std::memcpy(memory->input_row(y).data(), frame.pixels.data() + y * frame.desc.row_bytes(),
                  frame.desc.row_bytes());
    }
    return *std::move(memory);
  }

  // Calls test(name) once for every instruction set that this processor has, while the passes use it.
  static void on_each_instruction_set(const std::function<void(const std::string& name)>& test);
};

void HostTest::on_each_instruction_set(const std::function<void(const std::string& name)>& test) {
  const int64_t all = hwy::SupportedTargets() & HWY_TARGETS & (HWY_AVX2 | HWY_AVX3 | HWY_NEON);
  ASSERT_NE(all, 0);
  for (int64_t rest = all; rest != 0; rest &= rest - 1) {
    const int64_t target = rest & -rest;
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(target);
    test(hwy::TargetName(target));
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
}

// All statistics, the floats by their bits.
void expect_same_stats(const FrameStats& a, const FrameStats& b, const std::string& what) {
  const auto bits = [](const auto& floats) {
    std::vector<uint32_t> words;
    for (const float v : floats) words.push_back(std::bit_cast<uint32_t>(v));
    return words;
  };
  EXPECT_EQ(std::bit_cast<uint64_t>(a.mean_log2_luminance), std::bit_cast<uint64_t>(b.mean_log2_luminance))
      << what;
  EXPECT_EQ(std::bit_cast<uint32_t>(a.max_luminance), std::bit_cast<uint32_t>(b.max_luminance)) << what;
  EXPECT_EQ(std::bit_cast<uint32_t>(a.min_luminance), std::bit_cast<uint32_t>(b.min_luminance)) << what;
  EXPECT_EQ(a.metered_weight, b.metered_weight) << what;
  EXPECT_EQ(a.nan_components, b.nan_components) << what;
  EXPECT_EQ(a.infinite_components, b.infinite_components) << what;
  EXPECT_EQ(a.clamped_components, b.clamped_components) << what;
  EXPECT_EQ(a.negative_components, b.negative_components) << what;
  EXPECT_EQ(a.negative_scene_components, b.negative_scene_components) << what;
  EXPECT_EQ(a.absent_pixels, b.absent_pixels) << what;
  EXPECT_EQ(bits(a.tile_light), bits(b.tile_light)) << what;
  EXPECT_EQ(bits(a.print), bits(b.print)) << what;
  EXPECT_EQ(a.histogram, b.histogram) << what;
}

// The host's ingest meters every frame to the same bits as the device's.

// What may be in a frame besides light.
enum Content : uint32_t { kOrdinary, kNegative, kTranslucent, kBright, kBad, kEverything, kContents };

Texel texel_of(Content content, uint32_t x, uint32_t y) {
  const float light = std::exp2(20.0f * noise(x, y, 0) - 10.0f);
  Texel c = {light * noise(x, y, 1), light * noise(x, y, 2), light * noise(x, y, 3), 1.0f};
  if (noise(x, y, 4) < 0.1f) c = {0, 0, 0, 1};
  const float kind = noise(x, y, 5);
  if ((content == kNegative || content == kEverything) && kind < 0.1f) {
    c = {kind < 0.03f ? -0.0f : -c[0], kind < 0.06f ? c[1] : -c[1], -c[2], 1};
  }
  if (content == kTranslucent || content == kEverything) {
    c[3] = kind < 0.2f ? 0.0f : kind < 0.25f ? -1.0f : kind < 0.9f ? kind : 1.0f;
  }
  if ((content == kBright || content == kEverything) && noise(x, y, 6) < 0.2f) {
    const float sun = std::exp2(15.0f + 15.5f * noise(x, y, 7));  // some is beyond 2^30
    c = {sun, noise(x, y, 8) < 0.5f ? c[1] : -0.7f * sun, 0.5f * sun, c[3]};
  }
  if (content < kBad || kind > 0.995f || kind < 0.97f) return c;
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const float bad[] = {NAN, -NAN, kInf, -kInf, 1e9f, -65520.0f, 65519.0f, 1e-30f};
  c[static_cast<size_t>(x + y) % 4] = bad[static_cast<size_t>(kind * 1e5f) % std::size(bad)];
  return c;
}

WireFrame frame_of(uint32_t width, uint32_t height, v1::PixelFormat format, uint32_t content) {
  return make_frame(width, height, format, [content](uint32_t x, uint32_t y) {
    return texel_of(static_cast<Content>(content), x, y);
  });
}

struct Variant {
  const char* name;
  void (*change)(v1::Settings&);
};

v1::Metering& metering(v1::Settings& settings) { return *settings.mutable_exposure()->mutable_metering(); }

void set_spot(v1::Settings& settings) {
  metering(settings).set_weights(v1::Metering::WEIGHTS_SPOT);
  *metering(settings).mutable_spot() = rectangle(0, 0, 41, 33);
}

constexpr Variant kVariants[] = {
    {"as it is", [](v1::Settings&) {}},
    {"no bloom", [](v1::Settings& s) { s.mutable_bloom()->set_intensity(0); }},
    {"centre", [](v1::Settings& s) { metering(s).set_weights(v1::Metering::WEIGHTS_CENTER); }},
    {"spot", set_spot},
    {"percentile", [](v1::Settings& s) { metering(s).set_statistic(v1::Metering::STATISTIC_PERCENTILE); }},
    {"percentile, centre",
     [](v1::Settings& s) {
       metering(s).set_statistic(v1::Metering::STATISTIC_PERCENTILE);
       metering(s).set_weights(v1::Metering::WEIGHTS_CENTER);
     }},
    {"percentile, spot, dark ones ignored",
     [](v1::Settings& s) {
       metering(s).set_statistic(v1::Metering::STATISTIC_PERCENTILE);
       metering(s).set_ignore_below(0.02f);
       set_spot(s);
     }},
    {"dark ones ignored", [](v1::Settings& s) { metering(s).set_ignore_below(0.1f); }},
    {"wide primaries", [](v1::Settings& s) { s.set_input_primaries(v1::PRIMARIES_REC2020); }},
    {"wide primaries, percentile",
     [](v1::Settings& s) {
       s.set_input_primaries(v1::PRIMARIES_REC2020);
       metering(s).set_statistic(v1::Metering::STATISTIC_PERCENTILE);
     }},
    {"alpha ignored", [](v1::Settings& s) { s.set_alpha(v1::ALPHA_IGNORE); }},
    {"bad values rejected", [](v1::Settings& s) { s.set_bad_values(v1::BAD_VALUES_REJECT); }},
};

class HostIngest : public HostTest {
 protected:
  void SetUp() override {
    HostTest::SetUp();
    if (IsSkipped()) return;
    device_ = DeviceExecutor::create(device()).value();
  }

  // Meters the frame on the device and with every instruction set of the host, with as many threads as the
  // frame's width says.
  void expect_same_meter(const WireFrame& frame, const Settings& settings, const std::string& what) {
    FrameMemory memory = in_memory(frame, settings);
    IngestPlan plan = plan_ingest(memory.textures().layout, settings);
    plan.wants_histogram = true;  // if there is one
    const absl::StatusOr<Metered> by_device = device_->meter(memory, plan);
    HostExecutor host(device(), 1 + frame.desc.width % 3);
    on_each_instruction_set([&](const std::string& set) {
      const absl::StatusOr<Metered> by_host = host.meter(memory, plan);
      ASSERT_EQ(by_host.status(), by_device.status()) << set << ", " << what;
      if (!by_host.ok()) return;
      EXPECT_EQ(by_host->scrubbed, by_device->scrubbed) << set << ", " << what;
      EXPECT_EQ(by_host->alpha, by_device->alpha) << set << ", " << what;
      expect_same_stats(by_host->stats, by_device->stats, set + ", " + what);
    });
  }

  // Of every variant in every format: one frame of every width up to 67, or of every `step`th, and some large
  // ones of every content, or of every `step`th.
  void expect_same_at_every_size(uint32_t step = 1) {
    uint32_t first = 0;
    for (const v1::PixelFormat format : kFormats) {
      for (const Variant& variant : kVariants) {
        expect_same_at_every_size(format, variant, "format " + std::to_string(format) + ", " + variant.name,
                                  first++ % step, step);
        if (HasFailure()) return;
      }
    }
  }
  void expect_same_at_every_size(v1::PixelFormat format, const Variant& variant, const std::string& what,
                                 uint32_t first, uint32_t step) {
    v1::Settings message;
    variant.change(message);
    const Settings settings = checked(message);
    for (uint32_t width = 1 + first; width <= 67; width += step) {
      const uint32_t height = 1 + width * 29 % 67;
      expect_same_meter(frame_of(width, height, format, width % kContents), settings,
                        what + ", width " + std::to_string(width));
    }
    for (const auto& [width, height] : {std::pair{129u, 131u}, {2113u, 66u}, {333u, 1u}}) {
      for (uint32_t content = first % kContents; content < kContents; content += step) {
        expect_same_meter(frame_of(width, height, format, content), settings,
                          what + ", width " + std::to_string(width) + ", content " + std::to_string(content));
      }
    }
  }

  std::unique_ptr<DeviceExecutor> device_;
};

TEST_F(HostIngest, HasTheDevicesBits) { expect_same_at_every_size(/*step=*/7); }

TEST_F(HostIngest, HasTheDevicesBitsOfEveryVariantAtEverySize) { expect_same_at_every_size(); }

// The fixed-point logarithm and the luminance of every half, and of floats beside them.
TEST_F(HostIngest, HasTheDevicesBitsForEveryHalf) {
  for (const v1::PixelFormat format : kFormats) {
    const WireFrame frame = make_frame(256, 256, format, [](uint32_t x, uint32_t y) -> Texel {
      const uint32_t half = y * 256 + x;
      const float v = std::bit_cast<float>((half & 0x7fffu) << 13) * 0x1p112f;  // 2^(127 - 15)
      return {std::min(v, 65504.0f) * (half >= 0x8000 ? 0.999f : 1.0f), 0, 0, 1};
    });
    expect_same_meter(frame, {}, "every half in format " + std::to_string(format));
  }
}

TEST_F(HostIngest, HistogramsAreTheDevices) {
  v1::Settings message;
  metering(message).set_statistic(v1::Metering::STATISTIC_PERCENTILE);
  for (const v1::PixelFormat format : kFormats) {
    for (const auto weights : {v1::Metering::WEIGHTS_AVERAGE, v1::Metering::WEIGHTS_CENTER}) {
      metering(message).set_weights(weights);
      // Several copies of the histogram, and rows of tiles that share one.
      expect_same_meter(frame_of(1500, 700, format, kOrdinary), checked(message),
                        "histogram of format " + std::to_string(format));
    }
  }
}

// The host's bloom against the float64 twins, and the same bits on every instruction set, with any number of
// threads, and where only a part of the frame is lit.

// The last three end just behind a strip of a level (server/render/host/bloom.cc).
constexpr Size kBloomSizes[] = {{1, 1},     {1, 7},    {2, 2},     {3, 5},     {8, 3},      {17, 31},
                                {64, 64},   {67, 63},  {129, 127}, {333, 517}, {1000, 501}, {1, 1000},
                                {1091, 70}, {2500, 9}, {1026, 40}, {2050, 30}, {2066, 33}};

std::string words(const Size& size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

// A frame's bloom, made on the host.
struct Bloomed {
  FrameMemory memory;
  Metered metered;
  Plan plan;
};

class HostBloom : public HostTest {
 protected:
  // `everywhere`: every tile counts as lit.
  static Bloomed bloom_of(const WireFrame& frame, const Settings& settings, uint32_t threads = 2,
                          bool everywhere = false) {
    FrameMemory memory = in_memory(frame, settings);
    const TextureLayout& layout = memory.textures().layout;
    Metered metered = HostExecutor(device(), threads).meter(memory, plan_ingest(layout, settings)).value();
    if (everywhere) {
      for (float& light : metered.stats.tile_light) light = std::numeric_limits<float>::infinity();
    }
    Plan plan = plan_frame(layout, metered, settings, {});
    for (const auto& level : memory.textures().levels) {
      std::memset(level.buffer().mapped(), 0xff, level.buffer().bytes());  // NaN
    }
    Crew crew(threads);
    for (const BloomStep& step : plan.bloom_steps) host::run_bloom(step, memory.textures(), crew);
    return {std::move(memory), std::move(metered), std::move(plan)};
  }

  static void expect_level(const FrameMemory& memory, size_t level, const reference::Level& truth,
                           const std::string& what) {
    const host::LevelPlanes planes = host::level_planes(memory.textures(), level);
    ASSERT_EQ(planes.width, truth.width) << what;
    ASSERT_EQ(planes.height, truth.height) << what;
    double maximum = 0.0;
    double worst = 0.0;
    for (uint32_t y = 0; y < truth.height; ++y) {
      for (uint32_t x = 0; x < truth.width; ++x) {
        for (size_t k = 0; k < 3; ++k) {
          maximum = std::max(maximum, truth.at(x, y)[k]);
          const double error = std::abs(planes.row(y, k)[x] - truth.at(x, y)[k]);
          worst = std::isnan(error) ? std::numeric_limits<double>::infinity() : std::max(worst, error);
        }
      }
    }
    EXPECT_LE(worst, kBloomBound * maximum) << what << ", level " << level << ", maximum " << maximum;
  }

  // All floats of all levels.
  static std::vector<float> levels_of(const FrameMemory& memory) {
    std::vector<float> all;
    for (size_t level = 0; level < memory.textures().levels.size(); ++level) {
      const host::LevelPlanes planes = host::level_planes(memory.textures(), level);
      for (uint32_t y = 0; y < planes.height; ++y) {
        for (size_t k = 0; k < 3; ++k)
          all.insert(all.end(), planes.row(y, k), planes.row(y, k) + planes.width);
      }
    }
    return all;
  }

  static reference::Scene scene_of(const WireFrame& frame, const Settings& settings) {
    reference::BadCounts bad;
    return reference::ingest(frame.pixels, frame.desc.row_bytes(), frame.desc.width, frame.desc.height,
                             static_cast<uint32_t>(frame.desc.format), settings.to_scene(),
                             reference::Rounding::kHalf, &bad);
  }
};

// With n levels, the coarsest one still has D_{n-1}: the bright pass wrote it if n is 1, otherwise bloom_down
// did. Level 0 has B_0, which every bloom_up contributed to. So all n together check every level of every
// pass.
TEST_F(HostBloom, EveryLevelIsItsTwins) {
  for (const Size& size : kBloomSizes) {
    const WireFrame frame = natural(size.width, size.height);
    const reference::Scene scene = scene_of(frame, {});
    for (bool firefly : {true, false}) {
      std::vector<reference::Level> d = {
          reference::bright_pass(scene, {.threshold = 0.02, .firefly_weights = firefly})};
      for (uint32_t levels = 1; levels <= 6; ++levels) {
        v1::Settings settings;
        *settings.mutable_bloom() = bloom(v1::Bloom::KIND_MIP, 1, 0.02f, 0.5f, levels, firefly);
        const Bloomed bloomed = bloom_of(frame, checked(settings));
        const size_t count = bloomed.memory.textures().levels.size();
        if (!bloomed.plan.bloom() || count < levels) break;
        if (count > d.size()) d.push_back(reference::bloom_down(d.back()));
        expect_level(bloomed.memory, count - 1, d.back(), words(size));
        reference::Level b = d.back();
        for (size_t level = count - 1; level-- > 0;) {
          b = reference::bloom_up(d[level], b);
          expect_level(bloomed.memory, level, b, words(size));
        }
      }
    }
  }
}

// B_0 of every kind, tier and format, with a matrix and with bad values.
TEST_F(HostBloom, EveryKindIsItsTwins) {
  for (const Size& size : kBloomSizes) {
    for (const auto format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGBA32F, v1::PIXEL_FORMAT_RGB9E5}) {
      WireFrame frame = natural(size.width, size.height, format);
      if (format == v1::PIXEL_FORMAT_RGBA32F) {
        constexpr float kBad = std::numeric_limits<float>::quiet_NaN();
        std::memcpy(frame.pixels.data() + frame.pixels.size() / 32 * 16, &kBad, sizeof kBad);
      }
      for (const auto kind : {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
        for (const char* tier : {"standard", "draft"}) {
          v1::Settings message;
          message.set_tier(tier);
          *message.mutable_bloom() = bloom(kind, 0.5f, 0.05f, 0.5f, 4, true);
          if (format == v1::PIXEL_FORMAT_RGB9E5) message.set_input_primaries(v1::PRIMARIES_REC2020);
          const Settings settings = checked(message);
          const Bloomed bloomed = bloom_of(frame, settings);
          if (!bloomed.plan.bloom()) continue;
          reference::BloomSpec spec = bloomed.plan.reference.bloom.value();
          if (kind != v1::Bloom::KIND_GAUSSIAN) spec.level_size = bloomed.memory.textures().layout.level_size;
          uint32_t count;
          const reference::Level truth = reference::bloom(scene_of(frame, settings), spec,
                                                          bloomed.metered.stats.mean_log2_luminance, &count);
          expect_level(bloomed.memory, 0, truth,
                       words(size) + ", format " + std::to_string(format) + ", kind " + std::to_string(kind) +
                           ", " + tier);
        }
      }
    }
  }
}

TEST_F(HostBloom, HasTheSameBitsHoweverItIsMade) {
  const WireFrame frames[] = {lights(1500, 1100, {{700, 500}, {1498, 0}}), lights(67, 2000, {{3, 1990}}),
                              lights(1283, 131, {{1200, 64}}), natural(601, 399)};
  for (const WireFrame& frame : frames) {
    for (const auto kind : {v1::Bloom::KIND_MIP, v1::Bloom::KIND_CONSERVE, v1::Bloom::KIND_GAUSSIAN}) {
      for (const char* tier : {"standard", "draft"}) {
        v1::Settings message;
        message.set_tier(tier);
        message.mutable_bloom()->set_kind(kind);
        if (kind == v1::Bloom::KIND_GAUSSIAN) message.mutable_bloom()->set_threshold(8);
        const Settings settings = checked(message);
        const std::vector<float> dense = levels_of(bloom_of(frame, settings, 1, true).memory);
        on_each_instruction_set([&](const std::string& set) {
          for (const uint32_t threads : {1u, 2u, 3u}) {
            const std::vector<float> sparse = levels_of(bloom_of(frame, settings, threads).memory);
            ASSERT_EQ(sparse.size(), dense.size());
            EXPECT_EQ(std::memcmp(sparse.data(), dense.data(), dense.size() * sizeof(float)), 0)
                << words({frame.desc.width, frame.desc.height}) << ", kind " << kind << ", " << tier << ", "
                << set << ", threads " << threads;
          }
        });
      }
    }
  }
}

// The host's passes against the device's, and against themselves with other threads and instruction sets.

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

// Views that the host draws, against those of the device, and with other threads and instruction sets. Both
// are compared with the float64 twin in environment_view_test.cc.

class HostView : public HostTest {
 protected:
  // Null: the device draws.
  static std::unique_ptr<EnvironmentBaker> baker_with(Crew* crew) {
    auto baker = EnvironmentBaker::create(device(), pool(), crew);
    if (!baker.ok()) throw std::runtime_error(baker.status().ToString());
    return *std::move(baker);
  }

  static Environment environment_of(EnvironmentBaker& baker, const WireFrame& frame) {
    absl::StatusOr<PanoramaUpload> upload = baker.take(frame.desc);
    if (!upload.ok()) throw std::runtime_error(upload.status().ToString());
    for (uint32_t y = 0; y < frame.desc.height; ++y) {
      const auto row = upload->row(y);
      std::memcpy(row.data(), frame.pixels.data() + y * frame.desc.row_bytes(), frame.desc.row_bytes());
    }
    absl::StatusOr<Environment> environment = baker.finish(*std::move(upload), std::nullopt);
    if (!environment.ok()) throw std::runtime_error(environment.status().ToString());
    if (absl::Status status = baker.prepare_view(*environment, {4, 0.5}); !status.ok())
      throw std::runtime_error(status.ToString());
    return *std::move(environment);
  }

  // All bytes of the frame's input, with the padding of its rows, which nothing draws.
  static std::vector<std::byte> draw(EnvironmentBaker& baker, Environment& environment, const View& view,
                                     Size size) {
    absl::StatusOr<FrameMemory> memory = FrameMemory::take(
        pool(), device().summary(),
        layout_textures({size.width, size.height, v1::PIXEL_FORMAT_RGBA16F}, *Settings::from({})),
        Verify::kNo);
    if (!memory.ok()) throw std::runtime_error(memory.status().ToString());
    const TextureLayout& layout = memory->textures().layout;
    const Buffer& input = memory->textures().input.buffer();
    std::memset(input.mapped(), 0xff, input.bytes());
    if (absl::Status status = baker.render_view(environment, view, *memory); !status.ok())
      throw std::runtime_error(status.ToString());
    return {input.mapped(), input.mapped() + size_t{layout.pitch} * size.height * 8};
  }
};

View turned(double fov_deg) {
  View view;
  view.camera.rotation = camera_rotation(20, 15, 30);
  view.camera.fov_deg = fov_deg;
  return view;
}

// Level 0 alone, both sides of where it ends, two levels everywhere, and spheres of every kind.
std::vector<View> views() {
  std::vector<View> all = {turned(10), turned(22), turned(150)};
  for (const uint32_t samples : {1u, 4u, 16u}) {
    View view = turned(50);
    view.samples = samples;
    view.objects = lookdev_objects();
    // Behind and in one another.
    view.objects.push_back({{0.5, 0.2, -5}, 1.2, {0.3, 0.9, 0.1}, 0.5, 0.1, true});
    view.objects.push_back({{-0.7, 0.3, -4}, 0.4, {1, 1, 1}, 1, 0.02, true});
    all.push_back(view);
  }
  return all;
}

constexpr Size kViewSizes[] = {{1, 1}, {17, 3}, {66, 35}, {641, 47}};

class HostViewBits : public HostView {
 protected:
  static std::vector<std::vector<std::byte>> bits(uint32_t threads) {
    Crew crew(threads);
    const std::unique_ptr<EnvironmentBaker> baker = baker_with(&crew);
    Environment environment = environment_of(*baker, natural(512, 256));
    std::vector<std::vector<std::byte>> all;
    for (const View& view : views()) {
      for (const Size size : kViewSizes) all.push_back(draw(*baker, environment, view, size));
    }
    return all;
  }
};

TEST_F(HostViewBits, DoNotDependOnTheThreads) {
  const auto one = bits(1);
  for (const uint32_t threads : {2, 3, 7}) EXPECT_EQ(one, bits(threads)) << threads;
}

TEST_F(HostViewBits, DoNotDependOnTheInstructionSet) {
  const auto first = bits(2);
  on_each_instruction_set([&](const std::string& name) { EXPECT_EQ(first, bits(2)) << name; });
}

TEST_F(HostView, NothingBeyondARowIsTouched) {
  Crew crew(2);
  const std::unique_ptr<EnvironmentBaker> baker = baker_with(&crew);
  Environment environment = environment_of(*baker, flat(8, 4, {1, 1, 1, 1}));
  for (uint32_t width = 1; width <= 37; ++width) {
    for (const View& view : {turned(10), turned(150), views().back()}) {
      const std::vector<std::byte> pixels = draw(*baker, environment, view, {width, 3});
      const size_t pitch = pixels.size() / 3 / 8;
      for (size_t i = 0; i < pixels.size() / 8; ++i) {
        uint16_t halves[4];
        std::memcpy(halves, &pixels[i * 8], sizeof halves);
        EXPECT_EQ(halves[3], i % pitch < width ? 0x3c00 : 0xffff) << width << " wide, pixel " << i;
      }
    }
  }
}

// Black balls in white, each of which some pixel's ray touches: roundings decide whether the pixel shows it.
// Which ray meets which of them follows from operations that are rounded alike everywhere.
TEST_F(HostView, EveryPixelShowsTheDevicesObject) {
  Crew crew(2);
  const std::unique_ptr<EnvironmentBaker> on_host = baker_with(&crew), on_device = baker_with(nullptr);
  Environment environment = environment_of(*on_host, flat(8, 4, {1, 1, 1, 1}));
  for (uint32_t width = 120; width < 130; ++width) {
    View view = turned(70);
    const double p = 2 * std::tan(35 * 3.14159265358979323846 / 180) / 90;
    for (uint32_t i = 0; i < 60; ++i) {
      const double x = (i % 12 * 10 + 5.5 - width / 2.0) * p, y = (i / 12 * 18 + 7.5 - 45) * p;
      const double radius = 0.1 + 0.001 * i, away = 3 + noise(i, width, 0);
      const double across =
          radius / std::hypot(x, 1.0);  // along (1, 0, x), which is at a right angle to the ray
      view.objects.push_back(
          {{away * x + across, away * y, -away + across * x}, radius, {0, 0, 0}, 0, 1, true});
    }
    const auto host = draw(*on_host, environment, view, {width, 90});
    const auto device = draw(*on_device, environment, view, {width, 90});
    const size_t pitch = host.size() / 90 / 8;
    const auto is_ball = [&](const std::vector<std::byte>& pixels, size_t i) {
      uint16_t red;
      std::memcpy(&red, &pixels[i * 8], sizeof red);
      return red != 0x3c00;
    };
    for (size_t i = 0; i < host.size() / 8; ++i) {
      if (i % pitch >= width) continue;
      EXPECT_EQ(is_ball(host, i), is_ball(device, i)) << width << " wide, pixel " << i;
    }
  }
}

TEST_F(HostView, ARendererDrawsViewsWhereItMakesItsPasses) {
  Crew crew(2);
  const std::unique_ptr<EnvironmentBaker> on_host = baker_with(&crew), on_device = baker_with(nullptr);
  Environment environment = environment_of(*on_host, natural(512, 256));
  const View view = turned(60);
  const auto host = draw(*on_host, environment, view, {199, 99});
  const auto device = draw(*on_device, environment, view, {199, 99});
  EXPECT_NE(host, device);  // some roundings differ
  EXPECT_EQ(draw(renderer_with(ExecutorKind::kHost).baker(), environment, view, {199, 99}), host);
  EXPECT_EQ(draw(renderer_with(ExecutorKind::kDevice).baker(), environment, view, {199, 99}), device);
}

}  // namespace
}  // namespace candela::testing
