// Measures how far the ACES approximations (the fits, and the
// tables of the cheaper tiers) are from the whole transform.
#pragma once

#include <vector>

#include "client/cli/commands/report/errors.h"
#include "client/cli/commands/report/session.h"

namespace candela {

// Returns `aces` of docs/report/format.md.
absl::StatusOr<Json> compare_aces(const ReportSession& session, const std::vector<ReportImage>& images);

}  // namespace candela
