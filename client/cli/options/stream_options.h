// The options of `candela stream`, `candela meter` and `candela bench`.
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/cli/options/options.h"
#include "client/cli/options/picture_options.h"

namespace candela {

// What the options say before they are put together.
struct StreamArguments {
  std::vector<std::string> files;  // inputs, then the output
  StreamOptions options;
  PictureArguments picture;
};

// Each defines options; parsing fills the second argument, which outlives the app.
void add_stream_options(CLI::App& app, StreamArguments& arguments);
void add_meter_command(CLI::App& app, MeterOptions& options);
void add_bench_options(CLI::App& app, BenchOptions& options);

// After parsing: finds options that do not go together.
absl::Status finish_stream_options(StreamArguments& arguments);
absl::Status finish_bench_options(const BenchOptions& options);

// "WIDTHxHEIGHT", each at most kMaxDimension.
absl::Status parse_size(const std::string& text, uint32_t& width, uint32_t& height);

}  // namespace candela
