// The options that choose a view of an OpenColorIO configuration instead of a tone curve.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/cli/options/options.h"

namespace candela {

// Defines --ocio, --display, --view and --ocio-input. Parsing fills `view`, which outlives the app.
void add_view_options(CLI::App& app, ViewChoice& view);

// After parsing: refuses options that conflict, and notes those that have no effect. `encoded` says that
// `output` holds display values and not light.
absl::Status finish_view_options(PictureOptions& options, const std::string& output, bool encoded);

}  // namespace candela
