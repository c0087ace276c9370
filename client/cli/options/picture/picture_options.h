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
  int bits = 0;     // 8, 10 or 16; 0: not given
  int quality = 0;  // 0: not given
};

// Defines --part, --layer, --exr-view, --incomplete and --max-chunk-mib. Parsing fills `options`, which
// outlive the app.
void add_choice_options(CLI::App& app, PictureOptions& options);

// Defines --max-pixels, for a command that reads images.
void add_max_pixels_option(CLI::App& app, PictureOptions& options);

// Defines --bits and --quality; parsing fills `arguments`, which outlives the app. `with_film`: films of 10
// bits are made, too.
void add_image_options(CLI::App& app, PictureArguments& arguments, bool with_film = false);

// After parsing: chooses the output's format by the extension of `output`, and refuses options that conflict.
absl::Status finish_picture_options(PictureOptions& options, const PictureArguments& arguments,
                                    const std::string& output);
// The same for an output of this encoding. `output` names it in messages.
absl::Status finish_picture_options(PictureOptions& options, const PictureArguments& arguments,
                                    const std::string& output, const OutputEncoding& encoding);

// A usage error for "-": images are not read from a pipe, or with `stdin_too` only from standard input alone.
absl::Status check_input_names(const std::vector<std::string>& inputs, bool stdin_too = false);

// A usage error for an output that is a pipe or a film, or that looks like an option. With `stdout_too` "-"
// is good: it is standard output. With `film_too` the films are good that ffmpeg is started for.
absl::Status check_output_name(const std::string& output, bool stdout_too = false, bool film_too = false);

// A usage error if a server makes files of this encoding and `file`, by its extension, is of another one.
// `output` is what the user named.
absl::Status check_server_encoding(v1::Encoding encoding, const std::string& file, const std::string& output);

// Parses "WIDTHxHEIGHT"; each is at most kMaxDimension.
absl::Status parse_size(const std::string& text, uint32_t& width, uint32_t& height);

// Defines --rotation, of a panorama.
void add_rotation_option(CLI::App& app, const std::string& section, double& degrees);

}  // namespace candela
