// The options of `candela meter`.
#pragma once

#include <CLI/App.hpp>

#include "absl/status/status.h"
#include "client/run/options.h"

namespace candela {

// Defines the options; parsing fills `options`, which outlives the app.
void add_meter_options(CLI::App& app, MeterOptions& options);

// After parsing: refuses options that conflict.
absl::Status finish_meter_options(MeterOptions& options);

}  // namespace candela
