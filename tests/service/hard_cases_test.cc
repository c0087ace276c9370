// The hard cases of docs/pipeline.md section 6 over the wire, in every tier. Each gives a finite picture
// within its error.
#include <half.h>

#include <cmath>
#include <cstring>
#include <set>
#include <string>

#include "tests/service/service_fixture.h"
#include "tests/support/status.h"

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

// A case as a picture of half floats, verified.
absl::StatusOr<RenderResult> render_case(const Connection& connection, const HardCase& hard, uint32_t width,
                                         uint32_t height, v1::Settings settings) {
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16F);
  const WireFrame frame = make_frame(width, height, v1::PIXEL_FORMAT_RGBA32F, hard.texel);
  FrameView asked = view(frame);
  asked.verify = true;
  return connection.render(settings, asked);
}

// The bound of a tier that leaves bloom's finest level out.
constexpr double kNoBound = 255;

TEST_P(HardCases, GiveAFinitePictureWithinThePublishedErrorInEveryTier) {
  ASSERT_OK_AND_ASSIGN(const v1::GetServerInfoResponse info, connection().server_info());
  for (const v1::Tier& tier : info.tiers()) {
    for (const auto& [width, height] : {std::pair{1u, 1u}, {1u, 7u}, {3u, 5u}, {16384u, 1u}, {67u, 35u}}) {
      for (const HardCase& hard : hard_cases(width, height)) {
        for (const bool bloom : {true, false}) {
          v1::Settings settings;
          settings.set_tier(tier.name());
          if (!bloom) settings.mutable_bloom()->set_intensity(0);
          const absl::StatusOr<RenderResult> result =
              render_case(connection(), hard, width, height, settings);
          const std::string what =
              tier.name() + " " + hard.name + " " + std::to_string(width) + (bloom ? "" : " no bloom");
          ASSERT_OK(result) << what;
          EXPECT_TRUE(finite(*result)) << what;
          EXPECT_TRUE(std::isfinite(result->header.exposure())) << what;
          EXPECT_LE(result->header.verify().meter_error_ev(), 2e-5) << what;
          const double published = bloom ? tier.max_error_codes_with_bloom() : tier.max_error_codes();
          EXPECT_EQ(published == kNoBound, bloom && tier.name() == "draft") << what;
          // Half floats are display-linear, so no tier's transfer adds an error.
          EXPECT_LE(result->header.verify().max_error_codes(), published == kNoBound ? kNoBound : 4e-4)
              << what;
        }
      }
    }
  }
}

// What verification itself cannot tell apart: its images are floats.
constexpr double kFloatCodes = 5e-5;

TEST_P(HardCases, AreWithinTheBoundThatTheAnswerNames) {
  std::set<std::string> taken;
  for (const double codes : {0.05, 1.0}) {
    for (const HardCase& hard : hard_cases(67, 35)) {
      for (const bool bloom : {true, false}) {
        v1::Settings settings;
        settings.set_max_error_codes(codes);
        if (!bloom) settings.mutable_bloom()->set_intensity(0);
        const absl::StatusOr<RenderResult> result = render_case(connection(), hard, 67, 35, settings);
        const std::string what =
            hard.name + " within " + std::to_string(codes) + (bloom ? "" : " without bloom");
        ASSERT_OK(result) << what;
        const v1::ResultHeader& header = result->header;
        ASSERT_TRUE(header.has_error_bound_codes()) << what;
        EXPECT_LE(header.error_bound_codes(), codes) << what;
        EXPECT_LE(header.verify().max_error_codes(), header.error_bound_codes() + kFloatCodes)
            << what << ": " << header.tier_reason();
        taken.insert(header.tier());
      }
    }
  }
  EXPECT_TRUE(taken.contains("draft") && taken.contains("standard")) << "the cases are too easy or too hard";
}

// The luminance jumps from black to 65504 between two frames that are no time, a moment or a long time apart.
TEST_P(HardCases, AStepInLuminanceAdaptsToAFiniteExposure) {
  const WireFrame bright = flat(67, 35, {65504, 65504, 65504, 1});
  ASSERT_OK_AND_ASSIGN(const RenderResult dark, connection().render({}, view(flat(67, 35, {0, 0, 0, 1}))));
  EXPECT_EQ(dark.header.exposure(), 64.0);
  for (double elapsed : {0.0, 1e-9, 1.0 / 24, 1e9}) {
    FrameView asked = view(bright);
    asked.previous.emplace();
    asked.previous->set_exposure(dark.header.exposure());
    asked.previous->set_elapsed_seconds(elapsed);
    ASSERT_OK_AND_ASSIGN(const RenderResult result, connection().render({}, asked));
    const double target = 1.0 / 64;  // the smallest allowed by default
    EXPECT_EQ(result.header.target(), target);
    EXPECT_NEAR(std::log2(result.header.exposure()), -6 + 12 * std::exp(-elapsed), 1e-12) << elapsed;
  }
}

}  // namespace
}  // namespace candela::testing
