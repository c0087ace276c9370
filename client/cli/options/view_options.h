// The options that choose the way from light to display values: a curve, or a view of an OpenColorIO
// configuration.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/cli/options/options.h"

namespace candela {

// Defines --curve, --ocio, --display, --view and --ocio-input in a section of the help; parsing fills
// `options`, which outlives the app.
void add_view_options(CLI::App& app, const std::string& section, PictureOptions& options);

// After parsing: finds options that do not go together, and notes those that change nothing. `encoded`:
// `output` holds display values, not light.
absl::Status finish_view_options(PictureOptions& options, const std::string& output, bool encoded);

}  // namespace candela
