// The options of `candela report`.
#pragma once

#include <CLI/App.hpp>

#include "absl/status/status.h"
#include "client/cli/options/options.h"

namespace candela {

// Defines the options; parsing fills `options`, which outlives the app.
void add_report_options(CLI::App& app, ReportOptions& options);

// After parsing: takes the sizes that belong to --quick where none were given, and finds options that do not
// go together.
absl::Status finish_report_options(ReportOptions& options);

}  // namespace candela
