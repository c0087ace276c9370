// The host's ingest meters every frame to the same bits as the device's.
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

#include "tests/device/host/host_fixture.h"

namespace candela::testing {
namespace {

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

}  // namespace
}  // namespace candela::testing
