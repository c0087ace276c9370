#include "client/cli/options/render_options.h"

#include <algorithm>
#include <array>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "client/cli/options/enum_words.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/security_options.h"
#include "client/cli/options/usage.h"
#include "client/cli/options/view_options.h"
#include "client/image/image.h"

namespace candela {
namespace {

constexpr char kVerification[] = "Verification";
constexpr char kServer[] = "Server";

void add_previous_options(CLI::App& app, RenderOptions& options) {
  add_text(app, kExposureSection, "--previous-exposure", "X",
           absl::StrFormat(
               "Factor of the frame before, to adapt from; %s (default: none, the frame takes its target)",
               format_range(v1::kExposureLimit)),
           [&options](const std::string& text) {
             const absl::StatusOr<double> x = parse_number("--previous-exposure", text, v1::kExposureLimit);
             if (x.ok()) options.previous.set_exposure(*x);
             return x.status();
           });
  add_number(app, kExposureSection, "--elapsed", "S", v1::kElapsedSeconds, 0,
             "Seconds since the frame before",
             [&options](double s) { options.previous.set_elapsed_seconds(s); });
}

void add_verification_options(CLI::App& app, RenderOptions& options) {
  app.add_flag("--verify", options.verify,
               "Hold the image against a float64 reference and say how far it is off; takes seconds")
      ->group(kVerification);
  add_text(app, kVerification, "--error-map", "FILE.png",
           "Draw where it is off and how far; implies --verify", [&options](const std::string& path) {
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
    return usage_error(absl::StrFormat("--error-map %s: OUT is that file; give two", options.error_map));
  }
  return absl::OkStatus();
}

}  // namespace

void add_server_options(CLI::App& app, ServerChoice& choice) {
  add_text(app, kServer, "--server", "ADDRESS",
           "A running candelad, HOST:PORT or unix:PATH (default: none, a server inside this process)",
           [&choice](const std::string& address) {
             choice.address = address;
             return absl::OkStatus();
           });
  add_security_options(app, kServer, choice.security);
  add_text(app, kServer, "--device", "NAME|INDEX",
           "Device of the server inside: a part of its name, or its number (default: the best there is)",
           [&choice](const std::string& device) {
             choice.device = device;
             return absl::OkStatus();
           });
}

absl::Status check_server_options(const ServerChoice& choice) {
  if (choice.address.empty() || choice.device.empty()) return absl::OkStatus();
  return usage_error("--device is for rendering without --server, which has its own; give one of them");
}

void add_json_option(CLI::App& app, const std::string& section, const std::string& help, std::string& path) {
  add_text(app, section, "--json", "FILE|-", help, [&path](const std::string& text) {
    path = text;
    return absl::OkStatus();
  });
}

void add_render_options(CLI::App& app, RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  app.add_option("IN", options.input, "Image to render: OpenEXR, Radiance .hdr or PFM")
      ->required()
      ->option_text(" ");
  app.add_option("OUT", options.output, "File to write: .png, .jpg, .exr (half floats) or .pfm")
      ->required()
      ->option_text(" ");
  add_settings_options(app, options);
  add_previous_options(app, options);
  add_verification_options(app, options);
  add_image_options(app, arguments.picture);
  add_json_option(app, kOutputSection, "Write what was done as one line of JSON, - for stdout", options.json);
  app.add_flag("--quiet,-q", options.quiet, "Print nothing but errors")->group(kOutputSection);
  add_server_options(app, options.server);
}

absl::Status finish_render_options(RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  absl::Status status = finish_picture_options(options, arguments.picture, options.output);
  if (options.previous.exposure() == 0 && options.previous.elapsed_seconds() != 0) {
    status.Update(usage_error("--elapsed says how long ago --previous-exposure was; give that, too"));
  }
  status.Update(check_error_map(options));
  status.Update(check_server_options(options.server));
  return status;
}

}  // namespace candela
