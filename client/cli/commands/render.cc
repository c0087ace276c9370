// `candela render`: images, each for itself.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/algorithm/container.h"
#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/failure.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/render_batch.h"
#include "client/cli/json_output.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/render_report.h"
#include "client/cli/run_display.h"
#include "client/cli/terminal.h"
#include "client/image/read_formats.h"
#include "client/image/write/encodings.h"
#include "client/run/hdr_gain_map.h"
#include "client/run/options.h"
#include "client/run/output_files.h"
#include "client/run/picture_run.h"
#include "client/run/run.h"
#include "client/run/sequence.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The options as parsed, before they are combined and checked.
struct RenderArguments {
  std::vector<std::string> files;  // inputs, then the output
  std::string kind;                // --as, "" if not given
  std::string hdr_curve;           // --hdr-curve, "" if not given
  RenderOptions options;
  PictureArguments picture;
};

absl::Status check_error_map(const RenderOptions& options) {
  if (options.verify.error_map.empty() || options.extension.empty()) {
    return check_verify_options(options.verify, options.output);
  }
  return usage_error(absl::StrFormat(
      "--error-map %s: it shows the error of one image, but %s is a folder; name a file as OUT",
      options.verify.error_map, options.output));
}

// Whether an input may name more than one image.
bool is_pattern(const std::string& input) {
  std::error_code failed;
  if (std::filesystem::exists(input, failed)) return names_folder(input);
  return input.find_first_of("*?[%#@") != std::string::npos;
}

// The name with a space that two words are, if there is such a file: a shell splits it without quotes.
std::string name_with_space(const std::vector<std::string>& words) {
  std::error_code failed;
  for (size_t i = 0; i + 1 < words.size(); ++i) {
    const std::string name = words[i] + " " + words[i + 1];
    if (!std::filesystem::exists(words[i], failed) && std::filesystem::exists(name, failed)) return name;
  }
  return "";
}

// Whether a picture that is not there is to become an image that is.
bool are_swapped(const std::string& input, const std::string& output) {
  std::error_code failed;
  const auto from = output_encoding(input), to = output_encoding(output);
  const bool light = to.ok() ? (*to)->holds_light() : absl::EndsWithIgnoreCase(output, ".hdr");
  return from.ok() && (*from)->holds_codes() && light && !std::filesystem::exists(input, failed) &&
         std::filesystem::exists(output, failed);
}

// The words of --as: the encodings' extensions without the dot.
std::vector<std::string> folder_kinds() {
  std::vector<std::string> kinds;
  for (const OutputEncoding& encoding : output_encodings()) kinds.push_back(encoding.extension().substr(1));
  return kinds;
}

// The extension of images whose names do not say it.
absl::Status choose_kind(RenderArguments& arguments, std::string& extension) {
  const std::vector<std::string> kinds = folder_kinds();
  if (arguments.kind.empty()) arguments.kind = kinds.front();
  if (!absl::c_linear_search(kinds, arguments.kind)) return unknown_word("kind", arguments.kind, kinds);
  extension = "." + arguments.kind;
  return absl::OkStatus();
}

// Splits the files into inputs and output.
absl::Status set_files(RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  if (arguments.files.size() < 2) {
    return usage_error("render needs an image and an output: candela render in.exr out.png");
  }
  options.inputs.assign(arguments.files.begin(), arguments.files.end() - 1);
  options.output = arguments.files.back();
  RETURN_IF_ERROR(check_input_names(options.inputs, /*stdin_too=*/true));
  RETURN_IF_ERROR(check_output_name(options.output, /*stdout_too=*/true));
  if (const std::string name = name_with_space(arguments.files); !name.empty()) {
    return usage_error(absl::StrFormat("%s has a space in its name; write it in quotes, '%s'", name, name));
  }
  if (options.inputs.size() == 1 && are_swapped(options.inputs.front(), options.output)) {
    return usage_error(absl::StrFormat("the input comes first: candela render %s %s", options.output,
                                       options.inputs.front()));
  }
  if (options.output == "-") {
    if (options.inputs.size() == 1 && !is_pattern(options.inputs.front())) {
      return choose_kind(arguments, options.stdout_kind);
    }
    return usage_error("OUT is \"-\", which takes one image; several images need a folder, such as out/");
  }
  const bool several = options.inputs.size() > 1 || is_pattern(options.inputs.front());
  const bool named = std::filesystem::path(options.output).has_extension();
  if (!names_folder(options.output) && (!several || named)) {
    if (several) {
      return usage_error(absl::StrFormat("%s is one file; several images need a folder, such as %s/",
                                         options.output,
                                         std::filesystem::path(options.output).stem().string()));
    }
    if (arguments.kind.empty()) return absl::OkStatus();
    return usage_error(absl::StrFormat("--as %s is for images in a folder; %s says its own kind",
                                       arguments.kind, options.output));
  }
  for (const std::string& input : options.inputs) {
    if (input == "-") {
      return usage_error(absl::StrFormat(
          "IN is \"-\", which has no name for a file in %s; give a file as OUT", options.output));
    }
    std::error_code failed;
    const bool may_be_read =
        read_format_of(input) != nullptr && (is_pattern(input) || std::filesystem::exists(input, failed));
    if (const auto encoding = output_encoding(input);
        encoding.ok() && (*encoding)->holds_codes() && !may_be_read) {
      return usage_error(absl::StrFormat(
          "%s is no image that candela can read (%s), and the last argument, %s, is taken as the output "
          "folder",
          input, read_format_names(), options.output));
    }
  }
  return choose_kind(arguments, options.extension);
}

constexpr std::array kHdrCurves = {"match", "bt2390", "aces-2"};

// With bt2390 and aces-2 moves the peak from the settings to `options.gain_map_target`: the client makes the
// map, not the server.
absl::Status choose_hdr_picture(const std::string& word, RenderOptions& options) {
  if (word.empty()) return absl::OkStatus();
  if (!absl::c_linear_search(kHdrCurves, word)) {
    return unknown_word("HDR curve", word, {kHdrCurves.begin(), kHdrCurves.end()});
  }
  v1::Settings& settings = options.settings;
  if (!settings.has_gain_map_peak_nits()) {
    return usage_error(absl::StrFormat("--hdr-curve %s needs --gain-map NIT", word));
  }
  if (word == kHdrCurves[0]) return absl::OkStatus();
  if (!options.view.config.empty() || !options.lut.empty()) {
    return usage_error(
        absl::StrFormat("--hdr-curve %s: %s chooses a view, which has no HDR picture; give --curve", word,
                        options.lut.empty() ? options.view.source : "--lut"));
  }
  const bool srgb =
      settings.transfer() == v1::TRANSFER_SRGB || settings.transfer() == v1::TRANSFER_UNSPECIFIED;
  if (!srgb || settings.alpha() == v1::ALPHA_STRAIGHT) {
    return usage_error(
        absl::StrFormat("--%s: a gain map is beside an image in srgb whose alpha is not straight",
                        srgb ? "alpha straight" : "transfer " + v1::word_of(settings.transfer())));
  }
  HdrPicture& hdr = options.gain_map_target.emplace();
  hdr.curve = word == "bt2390" ? v1::TONE_CURVE_BT2390 : v1::TONE_CURVE_ACES_2;
  hdr.peak_nits = settings.gain_map_peak_nits();
  settings.clear_gain_map_peak_nits();
  if (hdr.curve == v1::TONE_CURVE_ACES_2 &&
      std::ranges::count(kAces2Greys, hdr.peak_nits, &Aces2Grey::peak_nits) == 0) {
    return usage_error(
        absl::StrFormat("--gain-map %g: --hdr-curve aces-2 is published for %s nit", hdr.peak_nits,
                        absl::StrJoin(kAces2Greys, ", ", [](std::string* out, const Aces2Grey& grey) {
                          absl::StrAppend(out, grey.peak_nits);
                        })));
  }
  return absl::OkStatus();
}

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_render_options(CLI::App& app, RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  app.add_option(
         "IN... OUT", arguments.files,
         absl::StrFormat(
             "IN: image to render: %s. OUT: file to write: %s. "
             "Several images, a folder's (%s), or a quoted pattern such as 'in/*.exr', need a folder as OUT; "
             "each is rendered for itself and keeps its name. Either may be -, standard input or output",
             read_format_names(), extensions_with(), read_extensions()))
      ->required()
      ->option_text(" ");
  add_only_option(app, options.only);
  add_choice_options(app, options);
  add_scene_light_option(app, options);
  add_sdr_option(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings);
  add_text(
      app, "Tone", "--hdr-curve", "NAME",
      absl::StrFormat("HDR picture of the gain map: the SDR picture with its highlights opened, or a second "
                      "rendering, in three channels: %s (default %s)",
                      absl::StrJoin(kHdrCurves, ", "), kHdrCurves[0]),
      arguments.hdr_curve);
  add_desqueeze_option(app, options);
  add_view_options(app, options);
  add_previous_options(app, options.previous);
  add_locked_exposure_option(app, options.locked_exposure);
  add_verify_options(app, options.verify);
  add_text(
      app, kOutputSection, "--as", "KIND",
      absl::StrFormat("Kind of the images in a folder, or of the one on standard output: %s (default %s)",
                      absl::StrJoin(folder_kinds(), ", "), folder_kinds().front()),
      arguments.kind);
  add_image_options(app, arguments.picture);
  add_json_option(app, kOutputSection,
                  "Write the result's numbers as one line of JSON an image; for a folder also one for all",
                  options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  app.add_flag("--verbose,-v", options.verbose, "Print everything about the result, not only a line")
      ->group(kOutputSection);
  add_servers_options(app, options.server);
}

// After parsing: tells a folder from a file, chooses the output's format and refuses options that conflict.
absl::Status finish_render_options(RenderArguments& arguments) {
  RenderOptions& options = arguments.options;
  RETURN_IF_ERROR(set_files(arguments));
  const std::string output =
      !options.stdout_kind.empty() ? options.output + options.stdout_kind
      : options.extension.empty()
          ? options.output
          : (std::filesystem::path(options.output) / ("*" + options.extension)).string();
  absl::Status status = finish_picture_options(options, arguments.picture, output);
  status.Update(choose_hdr_picture(arguments.hdr_curve, options));
  status.Update(finish_previous_options(options.previous));
  status.Update(finish_locked_exposure(options.locked_exposure, options.settings, options.previous));
  const bool exposure_given = !options.locked_exposure.empty() || options.previous.exposure() > 0;
  choose_sdr(options, exposure_given || options.gain_map_target);
  choose_view_defaults(options, exposure_given);
  status.Update(check_error_map(options));
  status.Update(finish_server_options(options.server));
  return status;
}

// Checks the files to write before the work, and makes their folders.
absl::Status prepare_outputs(const RenderOptions& options, const std::vector<RenderJob>& jobs) {
  std::vector<std::string> inputs = files_of(options.server);
  inputs.insert(inputs.end(), {options.view.config, options.locked_exposure});
  std::vector<OutputFile> outputs;
  for (const RenderJob& job : jobs) {
    inputs.push_back(job.input == "-" ? "/dev/stdin" : job.input);
    outputs.push_back({job.output, "the image"});
  }
  outputs.push_back({options.verify.error_map, "the error map"});
  outputs.push_back({options.json, "the JSON"});
  RETURN_IF_ERROR(check_outputs_apart(inputs, outputs));
  for (const std::string& path : {jobs.front().output, options.verify.error_map}) {
    if (path.empty() || path == "-") continue;
    RETURN_IF_ERROR(make_folder_of(path));
    if (const auto kind = check_output_path(path); !kind.ok()) return kind.status();
  }
  return absl::OkStatus();
}

absl::Status render_one(const RenderOptions& options, const RenderJob& job, Run& run, RunEvents& events,
                        JsonOutput& json, Progress& progress) {
  const absl::StatusOr<RenderReport> report = run_frame(options, job, /*only=*/true, run, events);
  progress.clear();
  if (!report.ok()) return about_input(report.status(), job.input);
  return tell(*report, options.quiet, options.verbose, json);
}

absl::Status render_folder(const RenderOptions& options, const std::vector<RenderJob>& jobs, Run& run,
                           JsonOutput& json, Progress& progress) {
  const auto render = [&](const RenderJob& job) {
    RunEvents silent;
    return run_frame(options, job, /*only=*/false, run, silent);
  };
  return render_batch(
      options, jobs, render, [&run] { return run.failure(); }, json, progress);
}

absl::Status run_render(const RenderOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const RenderPlan plan, plan_render(options));
  const std::vector<RenderJob>& jobs = plan.jobs;
  RETURN_IF_ERROR(prepare_outputs(options, jobs));
  RETURN_IF_ERROR(json.open());
  if (!options.stdout_kind.empty()) {
    RETURN_IF_ERROR(check_stdout(json));
  }
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  if (!options.quiet) print_left_out(plan.left_out);
  RunDisplay display(options.quiet, json, progress);
  Run run(options, display);
  RETURN_IF_ERROR(run.read_exposure());
  RETURN_IF_ERROR(run.bake());
  return options.extension.empty() ? render_one(options, jobs.front(), run, display, json, progress)
                                   : render_folder(options, jobs, run, json, progress);
}

constexpr char kRenderExamples[] =
    "Examples:\n"
    "  candela render in.exr out.png\n"
    "  candela render in.hdr out.png --exposure -2 --curve aces-narkowicz --bits 16\n"
    "  candela render a.exr b.hdr 'more/*.exr' out/ --as jpg --max-size 480\n"
    "  candela render in.exr out.jpg --server 127.0.0.1:50051 --json -\n"
    "  curl -s https://example.com/in.exr | candela render - - --as jpg | convert - -resize 25% out.jpg";

Finish define_render(CLI::App& app) {
  const auto arguments = std::make_shared<RenderArguments>();
  add_render_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_render_options(*arguments));
    RenderOptions& options = arguments->options;
    add_idle_notes(options,
                   {.given = given,
                    .encoding = encoding_of(options.extension.empty() ? options.output + options.stdout_kind
                                                                      : "*" + options.extension),
                    .view = !options.view.config.empty(),
                    .adapts = options.previous.exposure() > 0,
                    .elapsed_seconds = options.previous.elapsed_seconds()});
    return parsed_command(options, run_render);
  };
}

}  // namespace

const Command kRenderCommand{"render", "Renders an HDR image: exposure, bloom, tone curve.", kRenderExamples,
                             define_render};

}  // namespace candela
