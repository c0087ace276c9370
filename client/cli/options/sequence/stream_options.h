// The options of `candela stream`.
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/cli/options/picture/picture_options.h"
#include "client/run/options.h"

namespace candela {

// The options as parsed, before they are combined and checked.
struct StreamArguments {
  std::vector<std::string> files;  // inputs, then the output
  StreamOptions options;
  PictureArguments picture;
  std::string pipe;   // --pipe, "" if not given
  std::string codec;  // --codec, "" if not given
};

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_stream_options(CLI::App& app, StreamArguments& arguments);

// After parsing: refuses options that conflict.
absl::Status finish_stream_options(StreamArguments& arguments);

}  // namespace candela
