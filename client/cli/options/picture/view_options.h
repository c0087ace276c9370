// The options that choose a view of an OpenColorIO configuration instead of a tone curve.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/run/options.h"

namespace candela {

// Defines --ocio, --display, --ocio-view, --ocio-input and the options of --lut. Parsing fills `options`,
// which outlive the app.
void add_view_options(CLI::App& app, PictureOptions& options);

// After parsing: takes the configuration of the variable OCIO if there is none, unless the user chose a
// curve. Refuses options that conflict, and notes those that have no effect. `encoded` says that `output`
// holds display values and not light.
absl::Status finish_view_options(PictureOptions& options, const std::string& output, bool encoded);

// After the checks of the exposure: with --ocio, exposure is 0 EV unless the user chose one or
// `exposure_given`, and there is no bloom unless the user gave an option of it.
void choose_view_defaults(PictureOptions& options, bool exposure_given);

}  // namespace candela
