#include "client/cli/options/sequence/stream_options.h"

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/base/usage.h"
#include "client/cli/options/picture/exposure_options.h"
#include "client/cli/options/picture/settings_options.h"
#include "client/cli/options/picture/view_options.h"
#include "client/cli/options/sequence/session_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/words/option_kinds.h"
#include "client/image/encodings.h"
#include "client/run/sequence/sequence_files.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr v1::Range<double> kFirst{-1e9, 1e9};

}  // namespace

void add_stream_options(CLI::App& app, StreamArguments& arguments) {
  StreamOptions& options = arguments.options;
  app.add_option(
         "IN... OUT", arguments.files,
         absl::StrFormat(
             "IN: frames with a number in their names: a folder, files, 'in/*.exr', in/%%04d.exr or "
             "in/####.exr. OUT: a pattern for the frame's number, out/%%04d.png (%s), or a folder for .png, "
             "which keeps the names",
             extensions_with()))
      ->required()
      ->option_text(" ");
  add_session_options(app, options);
  add_choice_options(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings);
  add_given_exposure_options(app, options);
  add_view_options(app, options);
  add_image_options(app, arguments.picture);
  add_encoding_option(app, kOutputSection, options.encoding,
                      "Who encodes the files: this command (raw) or the server (png, jpeg)");
  add_text(
      app, kOutputSection, "--first", "N",
      absl::StrFormat("Number the images N, N + 1, ... in OUT's pattern; %s (default: each image has its "
                      "frame's number)",
                      format_range(kFirst)),
      [&options](const std::string& text) {
        const absl::StatusOr<double> first = parse_number("--first", text, kFirst, true);
        if (first.ok()) options.first = static_cast<int64_t>(*first);
        return first.status();
      });
  add_curve_options(app, options);
  add_json_option(app, kOutputSection, "Write one line of JSON a frame, and one for the whole session",
                  options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  add_session_server_options(app, options);
}

absl::Status finish_stream_options(StreamArguments& arguments) {
  StreamOptions& options = arguments.options;
  if (arguments.files.size() < 2) {
    return usage_error("stream needs input frames and an output: candela stream 'in/*.exr' out/%04d.png");
  }
  options.sequence.inputs.assign(arguments.files.begin(), arguments.files.end() - 1);
  options.output = arguments.files.back();
  RETURN_IF_ERROR(check_input_names(options.sequence.inputs));
  RETURN_IF_ERROR(check_output_name(options.output));
  const absl::StatusOr<OutputNames> names =
      OutputNames::parse(options.output, output_encoding(options.encoding).extension());
  if (!names.ok()) return names.status();
  if (names->is_folder() && options.first) {
    options.notes.push_back(
        "--first changes nothing: the images in a folder have the names of their frames; "
        "give a pattern such as out/%04d.png to number them");
  }
  const std::string sample = names->is_folder() ? options.output + "/*" + names->extension() : options.output;
  if (absl::Status status = finish_picture_options(options, arguments.picture, sample); !status.ok()) {
    return status;
  }
  if (absl::Status status = check_server_encoding(options.encoding, sample, options.output); !status.ok()) {
    return status;
  }
  RETURN_IF_ERROR(finish_exposure_options(options));
  choose_view_defaults(
      options, !options.exposures.empty() || !options.locked_exposure.empty() || !options.state.empty());
  return finish_server_options(options.server);
}

}  // namespace candela
