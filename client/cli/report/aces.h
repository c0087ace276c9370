// How far the approximations of ACES are from the whole transform: the fits, and the tables of cheaper tiers.
#pragma once

#include <vector>

#include "client/cli/report/errors.h"
#include "client/cli/report/session.h"

namespace candela {

// An object: tier, reference (the curve that the others are held against, at that tier) and either missing
// (why there is no comparison) or rows [{curve, tier, set, pixels, codes {max, p95, mean}, delta_e {max, p95,
// mean}} or {curve, tier, set, error}]. A pixel's codes are the largest difference of its R, G and B, in
// 1/255 of the display range, from 16-bit pictures; delta_e is CIEDE2000 of Little CMS, from XYZ under D65.
// Charts are taken at exposure 1, images as metered; none with bloom.
absl::StatusOr<Json> compare_aces(const ReportSession& session, const std::vector<ReportImage>& images);

}  // namespace candela
