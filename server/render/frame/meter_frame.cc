#include "server/render/frame/meter_frame.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace candela {

namespace {

absl::Status bad_pixel(const TileSums& sums, const FrameDesc& desc) {
  const FrameStats& stats = sums.stats;
  const bool all_finite = stats.nan_components + stats.infinite_components == 0;
  const std::string beyond = absl::StrFormat("%d component%s beyond 2^30", stats.clamped_components,
                                             stats.clamped_components == 1 ? "" : "s");
  const std::string counts =
      absl::StrFormat("%d NaN and %d infinite components", stats.nan_components, stats.infinite_components);
  return absl::InvalidArgumentError(absl::StrFormat(
      "the pixel at x %d, y %d is not %s (%s in all); repair the frame or use bad_values SCRUB",
      sums.first_bad_texel % desc.width, sums.first_bad_texel / desc.width,
      stats.clamped_components == 0 ? "finite"
      : all_finite                  ? "within 2^30"
                                    : "finite and within 2^30",
      all_finite                      ? beyond
      : stats.clamped_components == 0 ? counts
                                      : absl::StrCat(counts, ", ", beyond)));
}

}  // namespace

absl::StatusOr<Metered> meter_frame(const IngestPlan& plan, const FrameDesc& desc, ReadFrame read_frame) {
  Metered metered;
  IngestRead read;
  absl::StatusOr<TileSums> sums = read_frame(read, /*again=*/false, &metered.stages);
  while (sums.ok()) {
    metered.alpha |= sums->alpha_differs;
    if (metered.alpha && !plan.ignores_alpha && read.alpha == shader::METER_OPAQUE) {
      read.alpha = shader::METER_COVERAGE;
    } else if (sums->needs_scrub && !read.scrub) {
      read.scrub = true;
    } else if (sums->uncovered) {
      read.alpha = shader::METER_ALIKE;
      metered.uncovered = true;
    } else {
      break;
    }
    sums = read_frame(read, /*again=*/true, &metered.stages);
  }
  if (!sums.ok()) return sums.status();
  metered.scrubbed = read.scrub && sums->needs_scrub;
  if (plan.rejects_bad_values && sums->first_bad_texel != UINT32_MAX) return bad_pixel(*sums, desc);
  metered.stats = std::move(sums->stats);
  return metered;
}

}  // namespace candela
