// The options of `candela environment`.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/run/options.h"

namespace candela {

// The options as parsed, before they are combined and checked.
struct EnvironmentArguments {
  EnvironmentOptions options;
  std::string layout;   // "" if not given
  bool handed = false;  // --handedness is given
};

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_environment_options(CLI::App& app, EnvironmentArguments& arguments);

// After parsing: chooses the output's format and refuses options that conflict.
absl::Status finish_environment_options(EnvironmentArguments& arguments);

}  // namespace candela
