// The hard cases of docs/pipeline.md section 6 over the wire, in every tier. Each gives a finite picture
// within its error.
#include <half.h>

#include <cmath>
#include <cstring>

#include "tests/service/service_fixture.h"

namespace candela::testing {
namespace {

class HardCases : public ServiceTest {};
INSTANTIATE_TEST_SUITE_P(Transport, HardCases, ::testing::Bool(), transport_name);

bool finite(const RenderResult& result) {
  for (size_t at = 0; at < result.bytes; at += 2) {
    uint16_t bits;
    std::memcpy(&bits, result.data.get() + at, sizeof bits);
    if (!std::isfinite(imath_half_to_float(bits))) return false;
  }
  return true;
}

TEST_P(HardCases, GiveAFinitePictureWithAStatedErrorInEveryTier) {
  const absl::StatusOr<v1::GetServerInfoResponse> info = connection().server_info();
  ASSERT_TRUE(info.ok()) << info.status();
  for (const v1::Tier& tier : info->tiers()) {
    for (const auto& [width, height] : {std::pair{1u, 1u}, {1u, 7u}, {3u, 5u}, {16384u, 1u}, {67u, 35u}}) {
      for (const HardCase& hard : hard_cases(width, height)) {
        v1::Settings settings;
        settings.set_tier(tier.name());
        settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
        const WireFrame frame = make_frame(width, height, v1::PIXEL_FORMAT_RGBA32F, hard.texel);
        FrameView asked = view(frame);
        asked.verify = true;
        const absl::StatusOr<RenderResult> result = connection().render(settings, asked);
        const std::string what = tier.name() + " " + hard.name + " " + std::to_string(width);
        ASSERT_TRUE(result.ok()) << what << ": " << result.status();
        EXPECT_TRUE(finite(*result)) << what;
        EXPECT_TRUE(std::isfinite(result->header.exposure())) << what;
        EXPECT_LE(result->header.verify().max_error_codes(), tier.name() == "draft" ? 255.0 : 4e-4) << what;
        EXPECT_LE(result->header.verify().meter_error_ev(), 2e-5) << what;
      }
    }
  }
}

// The luminance jumps from black to 65504 between two frames that are no time, a moment or a long time apart.
TEST_P(HardCases, AStepInLuminanceAdaptsToAFiniteExposure) {
  const WireFrame bright = flat(67, 35, {65504, 65504, 65504, 1});
  const absl::StatusOr<RenderResult> dark = connection().render({}, view(flat(67, 35, {0, 0, 0, 1})));
  ASSERT_TRUE(dark.ok()) << dark.status();
  EXPECT_EQ(dark->header.exposure(), 64.0);
  for (double elapsed : {0.0, 1e-9, 1.0 / 24, 1e9}) {
    FrameView asked = view(bright);
    asked.previous.emplace();
    asked.previous->set_exposure(dark->header.exposure());
    asked.previous->set_elapsed_seconds(elapsed);
    const absl::StatusOr<RenderResult> result = connection().render({}, asked);
    ASSERT_TRUE(result.ok()) << result.status();
    const double target = 1.0 / 64;  // the smallest allowed by default
    EXPECT_EQ(result->header.target(), target);
    EXPECT_NEAR(std::log2(result->header.exposure()), -6 + 12 * std::exp(-elapsed), 1e-12) << elapsed;
  }
}

}  // namespace
}  // namespace candela::testing
