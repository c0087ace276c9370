// The options that compare an image with the float64 reference.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/run/options.h"

namespace candela {

// Defines --verify and --error-map. Parsing fills `choice`, which outlives the app.
void add_verify_options(CLI::App& app, VerifyChoice& choice);

// After parsing: refuses an error map that cannot be written beside the image `output`.
absl::Status check_verify_options(const VerifyChoice& choice, const std::string& output);

}  // namespace candela
