// The options of `candela bench`.
#pragma once

#include <CLI/App.hpp>

#include "client/cli/options/options.h"

namespace candela {

// Defines the options; parsing fills `options`, which outlives the app.
void add_bench_options(CLI::App& app, BenchOptions& options);

}  // namespace candela
