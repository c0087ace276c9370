#include "tests/support/frame_error.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "server/render/verify.h"

namespace candela::testing {

namespace {

// What the pipeline reaches, far inside section 6's 0.5 and 0.05, so that a worse shader is noticed. 0.0020
// of it is the rounding of RGBA16; the rest of the maximum is cancellation between components of +-65504.
constexpr double kMaxCodes = 0.010;
constexpr double kP999Codes = 0.0035;

}  // namespace

void FrameErrorTest::print_header(const std::string& what) {
  std::printf("%-44s %9s %9s %9s %9s %9s\n", what.c_str(), "max", "p99.9", "mean", "differ", "EV");
}

void FrameErrorTest::check(const WireFrame& frame, Settings settings, const std::string& what) {
  settings.output_format = OutputFormat::kRgba16;
  auto fine = render(frame, settings);
  ASSERT_TRUE(fine.ok()) << what << ": " << fine.status();
  const ReferenceFrame truth = render_reference(frame.desc, frame.pixels, settings, fine->report.exposure);
  const Difference codes = compare(fine->memory, settings, truth);
  const double ev = std::abs(fine->report.stats.mean_log2_luminance - truth.meter.mean_log2_luminance);
  settings.output_format = OutputFormat::kRgba8;
  auto coarse = render(frame, settings);
  ASSERT_TRUE(coarse.ok()) << what << ": " << coarse.status();
  const Difference counts = compare(coarse->memory, settings, truth);

  std::printf("%-44s %9.5f %9.5f %9.6f %8.4f%% %9.2e\n", what.c_str(), codes.max_codes, codes.p999_codes,
              codes.mean_codes,
              100.0 * static_cast<double>(counts.differing) / static_cast<double>(counts.components), ev);
  EXPECT_LE(ev, 2e-5) << what;
  EXPECT_LE(codes.max_codes, kMaxCodes) << what << " worst at " << codes.worst_x << ", " << codes.worst_y;
  EXPECT_LE(codes.p999_codes, kP999Codes) << what;
  EXPECT_LE(counts.max_difference, 1) << what;
  // 0.1 %, or one component of a frame too small for a percentage.
  EXPECT_LE(static_cast<double>(counts.differing),
            std::max(1.0, 1e-3 * static_cast<double>(counts.components)))
      << what;
  EXPECT_EQ(fine->report.stats.nan_components, truth.bad.nan) << what;
  EXPECT_EQ(fine->report.stats.infinite_components, truth.bad.infinite) << what;
  EXPECT_EQ(fine->report.stats.negative_components, truth.bad.negative) << what;
  EXPECT_NEAR(fine->report.stats.max_luminance, truth.meter.max_luminance, 1e-6 * truth.meter.max_luminance)
      << what;
  // Where components are negative, a luminance can be small by cancellation.
  const double cancelled = truth.bad.negative > 0 ? 1e-6 * truth.meter.max_luminance : 0.0;
  EXPECT_NEAR(fine->report.stats.min_luminance, truth.meter.min_luminance,
              1e-6 * truth.meter.min_luminance + cancelled)
      << what;
}

}  // namespace candela::testing
