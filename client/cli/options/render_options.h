// The options of `candela render`.
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/cli/options/picture/picture_options.h"
#include "client/run/options.h"

namespace candela {

// The options as parsed, before they are combined and checked.
struct RenderArguments {
  std::vector<std::string> files;  // inputs, then the output
  std::string kind;                // --as, "" if not given
  std::string hdr_curve;           // --hdr-curve, "" if not given
  RenderOptions options;
  PictureArguments picture;
};

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_render_options(CLI::App& app, RenderArguments& arguments);

// After parsing: tells a folder from a file, chooses the output's format and refuses options that conflict.
absl::Status finish_render_options(RenderArguments& arguments);

}  // namespace candela
