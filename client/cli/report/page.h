// A report's files, made from its data alone: the page and the tables.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/report/session.h"

namespace candela {

// A page that refers to nothing outside of itself. `report` is what report_command.cc puts together. Fails as
// plot_svg does.
absl::StatusOr<std::string> report_page(const Json& report);

// Writes index.html, report.json, times.csv, hard_cases.csv and aces.csv into `folder`, each whole or not at
// all.
absl::Status write_report(const Json& report, const std::string& folder);

}  // namespace candela
