// The options of every command that makes pictures: exposure, size, verification, a studio's view, files.
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "client/run/options.h"
#include "proto/candela/v1/settings.h"

namespace candela {

// The options for exposure files: exposures that are given, a state that is continued, and what is saved.

// Defines --locked-exposure. Parsing fills `file`, which outlives the app.
void add_locked_exposure_option(CLI::App& app, std::string& file);

// Defines --exposures and --locked-exposure.
void add_given_exposure_options(CLI::App& app, StreamOptions& options);

// Defines --state, in the given section of the help.
void add_state_option(CLI::App& app, const std::string& section, StreamOptions& options);

// Defines --save-exposures.
void add_save_exposures_option(CLI::App& app, StreamOptions& options);

// Defines --previous-exposure and --elapsed.
void add_previous_options(CLI::App& app, v1::ExposureState& previous);

// After parsing: refuses --elapsed alone.
absl::Status finish_previous_options(const v1::ExposureState& previous);

// After parsing: refuses --locked-exposure, whose file is `file`, beside options that decide the exposure,
// too.
absl::Status finish_locked_exposure(const std::string& file, const v1::Settings& settings,
                                    const v1::ExposureState& previous);

// After parsing: refuses options that conflict, and notes those that have no effect.
absl::Status finish_exposure_options(StreamOptions& options);

// The options for the size of images.

// Defines --resize and --max-size. `setting` is output_size. Parsing fills `settings`, which outlives the
// app.
void add_size_options(CLI::App& app, v1::Settings& settings, const v1::SettingField& setting);

// Defines --desqueeze, for a command whose frames are files.
void add_desqueeze_option(CLI::App& app, PictureOptions& options);

// After parsing: refuses both of the first two.
absl::Status check_size_options(const v1::Settings& settings);

// The options that compare an image with the float64 reference.

// Defines --verify and --error-map. Parsing fills `choice`, which outlives the app.
void add_verify_options(CLI::App& app, VerifyChoice& choice);

// After parsing: refuses an error map that cannot be written beside the image `output`.
absl::Status check_verify_options(const VerifyChoice& choice, const std::string& output);

// The options that choose a view of an OpenColorIO configuration instead of a tone curve.

// Defines --ocio, --display, --ocio-view, --ocio-input and the options of --lut. Parsing fills `options`,
// which outlive the app.
void add_view_options(CLI::App& app, PictureOptions& options);

// After parsing: takes the configuration of the variable OCIO if there is none, unless the user chose a
// curve. Refuses options that conflict, and notes those that have no effect. `encoded` says that `output`
// holds display values and not light.
absl::Status finish_view_options(PictureOptions& options, const std::string& output, bool encoded);

// After the checks of the exposure: with --ocio, exposure is 0 EV unless the user chose one or
// `exposure_given`, and there is no bloom unless the user gave an option of it.
void choose_view_defaults(PictureOptions& options, bool exposure_given);

// The options for the format of image files, and their checks against the settings.

// The options as parsed, before they are combined and checked.
struct PictureArguments {
  int bits = 0;     // 8, 10 or 16; 0: not given
  int quality = 0;  // 0: not given
};

// Defines --part, --layer, --exr-view, --incomplete and --max-chunk-mib. Parsing fills `options`, which
// outlive the app.
void add_choice_options(CLI::App& app, PictureOptions& options);

// Defines --scene-light, for a command that shows pictures.
void add_scene_light_option(CLI::App& app, PictureOptions& options);

// Defines --sdr, for a command that makes images of pictures.
void add_sdr_option(CLI::App& app, PictureOptions& options);
// After the checks of the exposure: whether the SDR picture beside a gain map is read, or its HDR light.
void choose_sdr(PictureOptions& options, bool exposure_given);

// Defines --max-pixels, for a command that reads images.
void add_max_pixels_option(CLI::App& app, PictureOptions& options);

// Defines --only. Parsing fills `extensions` as find_frames() takes them; they outlive the app.
void add_only_option(CLI::App& app, std::vector<std::string>& extensions);

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
