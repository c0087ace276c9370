// The options of `candela view` and `candela environment`.
#pragma once

#include <CLI/App.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/cli/options/picture/picture_options.h"
#include "client/run/options.h"

namespace candela {

// The options as parsed, before they are combined and checked.
struct PanoramaViewArguments {
  PanoramaViewOptions options;
  PictureArguments picture;
};

struct EnvironmentArguments {
  EnvironmentOptions options;
  std::string layout;   // "" if not given
  bool handed = false;  // --handedness is given
};

// Define the options; parsing fills `arguments`, which outlives the app.
void add_panorama_view_options(CLI::App& app, PanoramaViewArguments& arguments);
void add_environment_options(CLI::App& app, EnvironmentArguments& arguments);

// After parsing: choose the output's format and refuse options that conflict.
absl::Status finish_panorama_view_options(PanoramaViewArguments& arguments);
absl::Status finish_environment_options(EnvironmentArguments& arguments);

// --rotation, for both.
void add_rotation_option(CLI::App& app, const std::string& section, double& degrees);

}  // namespace candela
