// The options of `candela render`.
#pragma once

#include <CLI/App.hpp>
#include <array>

#include "absl/status/status.h"
#include "client/cli/options.h"

namespace candela {

// What the options say before they are put together.
struct RenderArguments {
  RenderOptions options;
  int bits = 0;     // 0: not given
  int quality = 0;  // 0: not given
};

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_render_options(CLI::App& app, RenderArguments& arguments);

// After parsing: chooses the output's format and finds options that do not go together.
absl::Status finish_render_options(RenderArguments& arguments);

// Red, green, blue and white, x before y.
v1::Chromaticities to_message(const std::array<float, 8>& xy);

// --server and --device, and --json: what `render` and `info` have in common.
void add_server_options(CLI::App& app, ServerChoice& choice);
absl::Status check_server_options(const ServerChoice& choice);  // after parsing
void add_json_option(CLI::App& app, const std::string& section, const std::string& help, std::string& path);

}  // namespace candela
