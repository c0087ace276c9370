// The options of `candela view`.
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

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_panorama_view_options(CLI::App& app, PanoramaViewArguments& arguments);

// After parsing: chooses the output's format and refuses options that conflict.
absl::Status finish_panorama_view_options(PanoramaViewArguments& arguments);

}  // namespace candela
