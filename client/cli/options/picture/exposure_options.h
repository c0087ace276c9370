// The options for exposure files: exposures that are given, a state that is continued, and what is saved.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/run/options.h"

namespace candela {

// Defines --locked-exposure. Parsing fills `file`, which outlives the app.
void add_locked_exposure_option(CLI::App& app, std::string& file);

// Defines --exposures and --locked-exposure.
void add_given_exposure_options(CLI::App& app, StreamOptions& options);

// Defines --state, in the given section of the help.
void add_state_option(CLI::App& app, const std::string& section, StreamOptions& options);

// Defines --save-exposures.
void add_save_exposures_option(CLI::App& app, StreamOptions& options);

// Defines --previous-exposure and --elapsed.
void add_previous_options(CLI::App& app, v1::ExposureState& previous);

// After parsing: refuses --elapsed alone.
absl::Status finish_previous_options(const v1::ExposureState& previous);

// After parsing: refuses --locked-exposure, whose file is `file`, beside options that decide the exposure,
// too.
absl::Status finish_locked_exposure(const std::string& file, const v1::Settings& settings,
                                    const v1::ExposureState& previous);

// After parsing: refuses options that conflict, and notes those that have no effect.
absl::Status finish_exposure_options(StreamOptions& options);

}  // namespace candela
