// The report's files: the data, the page that shows it, and the tables as CSV.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "client/cli/commands/report/session.h"

namespace candela {

// page/page.html with its scripts and without data. page/embed.cmake makes it.
extern const absl::string_view kPageTemplate;

// Writes report.json, index.html, times.csv, hard_cases.csv, aces.csv and bakes.csv into `folder`. Each file
// appears whole or not at all. docs/report/format.md describes `report`. The page loads nothing but the
// pictures, which are in `folder` already.
absl::Status write_report(const Json& report, const std::string& folder);

}  // namespace candela
