// The options for the format of image files, and their checks against the settings.
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/run/options.h"

namespace candela {

// The options as parsed, before they are combined and checked.
struct PictureArguments {
  int bits = 0;     // 0: not given
  int quality = 0;  // 0: not given
};

// Defines --part, --layer, --exr-view, --incomplete and --max-chunk-mib. Parsing fills `options`, which
// outlive the app.
void add_choice_options(CLI::App& app, PictureOptions& options);

// Defines --max-pixels, for a command that reads images.
void add_max_pixels_option(CLI::App& app, PictureOptions& options);

// Defines --bits and --quality; parsing fills `arguments`, which outlives the app.
void add_image_options(CLI::App& app, PictureArguments& arguments);

// After parsing: chooses the output's format by the extension of `output`, and refuses options that conflict.
absl::Status finish_picture_options(PictureOptions& options, const PictureArguments& arguments,
                                    const std::string& output);

// A usage error for "-": images are not read from a pipe.
absl::Status check_input_names(const std::vector<std::string>& inputs);

// A usage error for an output that is a pipe or a video, or that looks like an option.
absl::Status check_output_name(const std::string& output);

// A usage error if a server makes files of this encoding and `file`, by its extension, is of another one.
// `output` is what the user named.
absl::Status check_server_encoding(v1::Encoding encoding, const std::string& file, const std::string& output);

// Parses "WIDTHxHEIGHT"; each is at most kMaxDimension.
absl::Status parse_size(const std::string& text, uint32_t& width, uint32_t& height);

}  // namespace candela
