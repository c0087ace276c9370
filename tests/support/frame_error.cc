#include "tests/support/frame_error.h"

#include <algorithm>
#include <cstdio>

#include "tests/support/status.h"

namespace candela::testing {

namespace {

// Relative to the level's maximum. Section 6 allows 2^-9.
constexpr double kBloomError = 4e-6;

}  // namespace

void FrameErrorTest::print_header(const std::string& what) {
  std::printf("%-44s %9s %9s %9s %9s %9s %9s %9s\n", what.c_str(), "max", "p99.9", "mean", "differ", "EV",
              "bloom", "unrounded");
}

void FrameErrorTest::check(const WireFrame& frame, const v1::Settings& settings, const std::string& what,
                           Bounds bounds) {
  const auto rendered = render(frame, settings, {}, Verify::kYes);
  ASSERT_OK(rendered) << what;
  ASSERT_TRUE(rendered->report.verification) << what;
  const Verification& error = rendered->report.verification->rounded;
  const auto components = static_cast<double>(error.components);
  const auto differing = static_cast<double>(error.differing);
  std::printf("%-44s %9.6f %9.6f %9.7f %8.4f%% %9.2e %9.2e %9.5f\n", what.c_str(), error.max_codes,
              error.p999_codes, error.mean_codes, 100.0 * differing / components, error.meter_error_ev,
              error.bloom_error, rendered->report.verification->unrounded.max_codes);
  EXPECT_LE(error.meter_error_ev, 8e-6) << what;
  EXPECT_LE(error.bloom_error, kBloomError) << what;
  EXPECT_LE(error.max_codes, bounds.max) << what << " worst at " << error.worst_x << ", " << error.worst_y;
  EXPECT_LE(error.p999_codes, bounds.p999) << what;
  EXPECT_LE(error.max_difference, 1) << what;
  // 0.2 %, or one component if the frame is too small for a percentage.
  EXPECT_LE(differing, std::max(1.0, 2e-3 * components)) << what;
  const FrameStats& stats = rendered->report.stats;
  const FrameStats& truth = rendered->report.verification->truth;
  EXPECT_EQ(stats.nan_components, truth.nan_components) << what;
  EXPECT_EQ(stats.infinite_components, truth.infinite_components) << what;
  EXPECT_EQ(stats.clamped_components, truth.clamped_components) << what;
  EXPECT_EQ(stats.negative_components, truth.negative_components) << what;
  EXPECT_EQ(stats.negative_scene_components, truth.negative_scene_components) << what;
  EXPECT_NEAR(stats.max_luminance, truth.max_luminance, 1e-6 * truth.max_luminance) << what;
  // With negative components a luminance can be small by cancellation.
  const double cancelled = truth.negative_components > 0 ? 1e-6 * truth.max_luminance : 0.0;
  EXPECT_NEAR(stats.min_luminance, truth.min_luminance, 1e-6 * truth.min_luminance + cancelled) << what;
}

}  // namespace candela::testing
