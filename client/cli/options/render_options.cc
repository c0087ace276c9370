#include "client/cli/options/render_options.h"

#include "absl/strings/str_format.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/options/usage.h"
#include "client/cli/options/view_options.h"
#include "client/image/image.h"

namespace candela {
namespace {

constexpr char kVerification[] = "Verification";

void add_previous_options(CLI::App& app, RenderOptions& options) {
  add_text(
      app, kExposureSection, "--previous-exposure", "FACTOR",
      absl::StrFormat(
          "Exposure of the previous frame, to adapt from; %s (default: none, the frame takes its target)",
          format_range(v1::kExposureLimit)),
      [&options](const std::string& text) {
        const absl::StatusOr<double> x = parse_number("--previous-exposure", text, v1::kExposureLimit);
        if (x.ok()) options.previous.set_exposure(*x);
        return x.status();
      });
  add_number(app, kExposureSection, "--elapsed", "SECONDS", v1::kElapsedSeconds, 0,
             "Media time since the previous frame",
             [&options](double s) { options.previous.set_elapsed_seconds(s); });
}

void add_verification_options(CLI::App& app, RenderOptions& options) {
  app.add_flag("--verify", options.verify,
               "Compare the image with the float64 reference and report the error; takes seconds")
      ->group(kVerification);
  add_text(app, kVerification, "--error-map", "FILE.png", "Draw the error of every pixel; implies --verify",
           [&options](const std::string& path) {
             options.error_map = path;
             options.verify = true;
             return absl::OkStatus();
           });
}

absl::Status check_error_map(const RenderOptions& options) {
  if (options.error_map.empty()) return absl::OkStatus();
  const absl::StatusOr<OutputKind> kind = output_kind(options.error_map);
  if (!kind.ok() || *kind != OutputKind::kPng) {
    return usage_error(absl::StrFormat("--error-map %s: an error map is written as .png", options.error_map));
  }
  if (options.error_map == options.output) {
    return usage_error(
        absl::StrFormat("--error-map %s: OUT is the same file; give another name", options.error_map));
  }
  return absl::OkStatus();
}

}  // namespace

void add_render_options(CLI::App& app, RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  app.add_option("IN", options.input, "Image to render: OpenEXR, Radiance .hdr or PFM")
      ->required()
      ->option_text(" ");
  app.add_option("OUT", options.output, "File to write: .png, .jpg, .exr (half floats) or .pfm")
      ->required()
      ->option_text(" ");
  add_settings_options(app, options.settings);
  add_view_options(app, options.view);
  add_previous_options(app, options);
  add_verification_options(app, options);
  add_image_options(app, arguments.picture);
  add_json_option(app, kOutputSection, "Write the result's numbers as one line of JSON", options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  add_server_options(app, options.server);
}

absl::Status finish_render_options(RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  absl::Status status = check_output_name(options.output);
  status.Update(finish_picture_options(options, arguments.picture, options.output));
  if (options.previous.exposure() == 0 && options.previous.elapsed_seconds() != 0) {
    status.Update(usage_error("--elapsed needs --previous-exposure; give both"));
  }
  status.Update(check_error_map(options));
  status.Update(finish_server_options(options.server));
  return status;
}

}  // namespace candela
