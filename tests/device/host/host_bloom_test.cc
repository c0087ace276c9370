// The host's bloom against the float64 twins, and the same bits on every instruction set, with any number of
// threads, and where only a part of the frame is lit.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/render/host/bloom.h"
#include "shaders/reference.h"
#include "tests/device/host/host_fixture.h"

namespace candela::testing {
namespace {

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

}  // namespace
}  // namespace candela::testing
