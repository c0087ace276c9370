// The kinds of files: what each costs to write and read, and what it loses. docs/report/format.md describes
// the rows.
#pragma once

#include <string>

#include "client/cli/commands/report/pictures.h"
#include "client/cli/commands/report/session.h"

namespace candela {

// Rows of `files`, of one image at bounded_tier(). Writes into `folder` and removes what it wrote.
absl::StatusOr<Json> measure_files(const ReportSession& session, const ReportImage& image,
                                   const std::string& folder);

}  // namespace candela
