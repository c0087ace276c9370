#include "server/render/device/meter_frame.h"

#include <utility>

#include "absl/strings/str_format.h"

namespace candela {

namespace {

absl::Status bad_pixel(const TileSums& sums, const FrameDesc& desc) {
  return absl::InvalidArgumentError(
      absl::StrFormat("the pixel at x %d, y %d is not finite (%d NaN and %d infinite components in all); "
                      "repair the frame or use "
                      "bad_values SCRUB",
                      sums.first_bad_texel % desc.width, sums.first_bad_texel / desc.width,
                      sums.stats.nan_components, sums.stats.infinite_components));
}

}  // namespace

absl::StatusOr<Metered> meter_frame(const IngestPlan& plan, const FrameDesc& desc, ReadFrame read_frame) {
  Metered metered;
  IngestRead read;
  absl::StatusOr<TileSums> sums = read_frame(read, /*again=*/false, &metered.stages);
  while (sums.ok()) {
    metered.alpha |= sums->alpha_differs;
    if (metered.alpha && !plan.ignores_alpha && !read.alpha) {
      read.alpha = true;
    } else if (sums->needs_scrub && !read.scrub) {
      read.scrub = true;
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
