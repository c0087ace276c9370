// The options of `candela report`.
#pragma once

#include <CLI/App.hpp>

#include "absl/status/status.h"
#include "client/cli/options/options.h"

namespace candela {

// Defines the options; parsing fills `options`, which outlives the app.
void add_report_options(CLI::App& app, ReportOptions& options);

// After parsing: sets the default sizes if none were given, and refuses options that conflict.
absl::Status finish_report_options(ReportOptions& options);

}  // namespace candela
