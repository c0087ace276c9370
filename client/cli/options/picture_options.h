// The options that say how frames are rendered and what the images are written as: those that the commands
// have in common.
#pragma once

#include <CLI/App.hpp>
#include <array>
#include <string>

#include "absl/status/status.h"
#include "client/cli/options/options.h"

namespace candela {

// Sections of the help.
inline constexpr char kExposureSection[] = "Exposure";
inline constexpr char kOutputSection[] = "Output";

// What the options say before they are put together.
struct PictureArguments {
  int bits = 0;     // 0: not given
  int quality = 0;  // 0: not given
};

// Each defines options; parsing fills the second argument, which outlives the app.
void add_settings_options(CLI::App& app, PictureOptions& options);   // exposure to tone
void add_meter_options(CLI::App& app, v1::Settings& settings);       // those of them that metering looks at
void add_image_options(CLI::App& app, PictureArguments& arguments);  // --bits and --quality

// After parsing: chooses the output's format by the extension of `output` and finds options that do not go
// together.
absl::Status finish_picture_options(PictureOptions& options, const PictureArguments& arguments,
                                    const std::string& output);
absl::Status check_meter_options(const v1::Settings& settings);

// Red, green, blue and white, x before y.
v1::Chromaticities to_message(const std::array<float, 8>& xy);

}  // namespace candela
