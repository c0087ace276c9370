// `candela view`: views of a panorama.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/json_output.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/options/picture_options.h"
#include "client/cli/options/server_options.h"
#include "client/cli/options/session_options.h"
#include "client/cli/options/settings_options.h"
#include "client/cli/render_report.h"
#include "client/cli/run_display.h"
#include "client/cli/stream_report.h"
#include "client/cli/terminal.h"
#include "client/image/write/encodings.h"
#include "client/run/frame_numbers.h"
#include "client/run/options.h"
#include "client/run/output_files.h"
#include "client/run/sequence.h"
#include "client/run/view_run.h"
#include "client/run/view_scene.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The options as parsed, before they are combined and checked.
struct PanoramaViewArguments {
  PanoramaViewOptions options;
  PictureArguments picture;
};

constexpr char kCamera[] = "Camera";
constexpr char kMove[] = "Sequence";
constexpr v1::Range<double> kTurnDeg{-36000, 36000};
constexpr v1::Range<double> kFrames{1, kMostViewFrames};

// A view is opaque, so settings about alpha would change nothing.
bool is_for_views(const v1::SettingField& setting) {
  return setting.path != "alpha" && setting.declaration().flag() != "background";
}

void add_camera_options(CLI::App& app, PanoramaViewOptions& options) {
  v1::Camera& camera = options.camera;
  const auto degrees = [&](const char* name, v1::Range<double> range, double initial, const char* help,
                           void (v1::Camera::*set)(double)) {
    add_number(app, kCamera, name, "DEG", range, initial, help,
               [&camera, set](double value) { (camera.*set)(value); });
  };
  degrees("--yaw", v1::kCameraAngleDeg, 0, "Turn the camera to the right; 0 looks at the panorama's middle",
          &v1::Camera::set_yaw_deg);
  degrees("--pitch", v1::kCameraAngleDeg, 0, "Raise the camera; 90 looks straight up",
          &v1::Camera::set_pitch_deg);
  degrees("--roll", v1::kCameraAngleDeg, 0, "Lean the camera to its right", &v1::Camera::set_roll_deg);
  degrees("--fov", v1::kFovDeg, v1::kDefaultFovDeg, "Vertical field of view", &v1::Camera::set_fov_deg);
  add_text(app, kCamera, "--size", "WIDTHxHEIGHT",
           absl::StrFormat("Size of the view in pixels; 1x1 .. %dx%d (default %dx%d)", v1::kMaxDimension,
                           v1::kMaxDimension, options.width, options.height),
           [&options](const std::string& text) { return parse_size(text, options.width, options.height); });
  add_text(app, kCamera, "--samples", "1|4|16",
           absl::StrFormat("Rays per pixel at the edges of objects (default %d)", v1::kDefaultViewSamples),
           [&options](const std::string& text) {
             if (text != "1" && text != "4" && text != "16") {
               return usage_error(absl::StrFormat("--samples is \"%s\"; it must be 1, 4 or 16", text));
             }
             options.samples = text == "1" ? 1 : text == "4" ? 4 : 16;
             return absl::OkStatus();
           });
  add_rotation_option(app, kCamera, options.rotation_deg);
  add_text(
      app, kCamera, "--objects", "lookdev|FILE.json",
      "Spheres to draw: lookdev (chrome, grey, gold, plastic), or those of a file, "
      "{\"objects\":[{\"centre\":[x,y,z],\"radius\":r,\"base_color\":[r,g,b],\"metallic\":m,"
      "\"roughness\":r,\"fixed_to_camera\":true}]}, where +X is right, +Y up and -Z ahead (default: none)",
      options.objects);
}

void add_move_options(CLI::App& app, PanoramaViewOptions& options) {
  add_text(app, kMove, "--turn", "DEG",
           absl::StrFormat(
               "Render a sequence that turns the camera right by DEG degrees; the last frame stops one "
               "step short, so that 360 loops; %s",
               format_range(kTurnDeg)),
           [&options](const std::string& text) {
             const absl::StatusOr<double> turn = parse_number("--turn", text, kTurnDeg);
             if (turn.ok()) options.turn_deg = *turn;
             return turn.status();
           });
  add_text(app, kMove, "--path", "FILE.json",
           "Render a sequence that follows camera keys, {\"keys\":[{\"time\":s,\"yaw\":deg,\"pitch\":deg,"
           "\"roll\":deg,\"fov\":deg}]}; between keys the camera moves smoothly and never beyond them",
           options.camera_path);
  add_text(app, kMove, "--frames", "N",
           absl::StrFormat("Number of frames; %s (default: 10 seconds of a turn, or all up to the last key)",
                           format_range(kFrames)),
           [&options](const std::string& text) {
             const absl::StatusOr<double> frames = parse_number("--frames", text, kFrames, true);
             if (frames.ok()) options.frames = static_cast<uint64_t>(*frames);
             return frames.status();
           });
  add_text(app, kMove, "--fps", "FPS",
           absl::StrFormat("Frames a second of media time, such as 25, 24000/1001 or 23.976, which is the "
                           "same; %s (default 24)",
                           format_range(kFps)),
           [&options](const std::string& text) {
             const absl::StatusOr<FrameRate> rate = parse_frame_rate("--fps", text);
             if (rate.ok()) options.rate = *rate;
             return rate.status();
           });
  add_lookahead_option(app, kMove, options.lookahead);
  add_text(app, kMove, "--session", "NAME", "Name of the session (default: a random one)", options.session);
}

// Options that only a sequence takes, or only a single view.
absl::Status check_kind(const PanoramaViewOptions& options) {
  if (options.turn_deg && !options.camera_path.empty()) {
    return usage_error("--turn and --path both move the camera; give only one of them");
  }
  if (options.is_sequence()) {
    if (options.verify.verify) {
      return usage_error("--verify is for a single view; render one of the sequence's views with its camera");
    }
    if (options.previous.exposure() == 0) return absl::OkStatus();
    return usage_error("--previous-exposure is for a single view; in a sequence exposure adapts by itself");
  }
  const absl::StatusOr<std::optional<NamePattern>> pattern = parse_name_pattern(options.output);
  const bool numbered = pattern.ok() && *pattern && options.output.find('%') != std::string::npos;
  const std::pair<bool, const char*> alone[] = {{options.frames.has_value(), "--frames"},
                                                {options.rate.has_value(), "--fps"},
                                                {options.lookahead > 0, "--lookahead"},
                                                {!options.session.empty(), "--session"},
                                                {!options.plot.empty(), "--exposure-plot"},
                                                {options.encoding != v1::ENCODING_RAW, "--encoding"},
                                                {numbered, "a pattern as OUT"}};
  for (const auto& [given, name] : alone) {
    if (given) {
      return usage_error(
          absl::StrFormat("%s is for a sequence; move the camera with --turn DEG or --path FILE.json", name));
    }
  }
  return absl::OkStatus();
}

absl::Status check_verify(const PanoramaViewOptions& options) {
  if (options.verify.verify && !options.view.config.empty()) {
    return usage_error(
        "--verify compares a view of --ocio with the frame's pixels, and only the server has "
        "those of a panorama's view; leave out one of the two");
  }
  return check_verify_options(options.verify, options.output);
}

// The name of one of the output's files, by which its format is chosen.
absl::StatusOr<std::string> sample_name(const PanoramaViewOptions& options) {
  if (!options.is_sequence()) return options.output;
  ASSIGN_OR_RETURN(const OutputNames names,
                   OutputNames::parse(options.output, output_encoding(options.encoding).extension()));
  std::string name = names.path(0, "");
  if (absl::Status status = check_server_encoding(options.encoding, name, options.output); !status.ok()) {
    return status;
  }
  return name;
}

// Defines the options; parsing fills `arguments`, which outlives the app.
void add_panorama_view_options(CLI::App& app, PanoramaViewArguments& arguments) {
  PanoramaViewOptions& options = arguments.options;
  app.add_option("PANO", options.panorama,
                 "Panorama in the equirectangular projection, twice as wide as high: OpenEXR, Radiance .hdr "
                 "or PFM; --primaries and --bad-values are about it")
      ->required()
      ->option_text(" ");
  app.add_option("OUT", options.output,
                 absl::StrFormat("File to write: %s; for a sequence a pattern for the frame's number, "
                                 "out/%%04d.png, or a folder for .png",
                                 extensions_with()))
      ->required()
      ->option_text(" ");
  add_camera_options(app, options);
  add_move_options(app, options);
  add_choice_options(app, options);
  add_scene_light_option(app, options);
  add_max_pixels_option(app, options);
  add_settings_options(app, options.settings, is_for_views);
  add_view_options(app, options);
  add_previous_options(app, options.previous);
  add_locked_exposure_option(app, options.locked_exposure);
  add_verify_options(app, options.verify);
  add_image_options(app, arguments.picture);
  add_encoding_option(app, kOutputSection, options.encoding,
                      "Who encodes the files of a sequence: this command (raw) or the server (png, jpeg)");
  add_text(app, kOutputSection, "--exposure-plot", "FILE",
           "Draw a sequence's exposure over time: a .svg file", options.plot);
  add_json_option(app, kOutputSection,
                  "Write the result's numbers as one line of JSON; for a sequence one line a frame, and one "
                  "for all",
                  options.json);
  add_quiet_option(app, kOutputSection, options.quiet);
  app.add_flag("--verbose,-v", options.verbose, "Print everything about a single view, not only a line")
      ->group(kOutputSection);
  options.server.bakes = true;
  add_servers_options(app, options.server);
}

// After parsing: chooses the output's format and refuses options that conflict.
absl::Status finish_panorama_view_options(PanoramaViewArguments& arguments) {
  PanoramaViewOptions& options = arguments.options;
  RETURN_IF_ERROR(check_input_names({options.panorama}));
  RETURN_IF_ERROR(check_output_name(options.output));
  RETURN_IF_ERROR(check_kind(options));
  ASSIGN_OR_RETURN(const std::string name, sample_name(options));
  absl::Status status = finish_picture_options(options, arguments.picture, name);
  options.settings.set_alpha(v1::ALPHA_IGNORE);  // a view has none
  status.Update(finish_previous_options(options.previous));
  status.Update(finish_locked_exposure(options.locked_exposure, options.settings, options.previous));
  choose_view_defaults(options, !options.locked_exposure.empty() || options.previous.exposure() > 0);
  status.Update(check_verify(options));
  status.Update(finish_server_options(options.server));
  return status;
}

// `candela view`: a picture of a panorama, or a sequence of them.

// The inputs, which no output may replace.
std::vector<std::string> inputs_of(const PanoramaViewOptions& options) {
  std::vector<std::string> inputs = files_of(options.server);
  inputs.insert(inputs.end(),
                {options.panorama, options.view.config, options.locked_exposure, options.camera_path});
  if (options.objects != kLookdev) inputs.push_back(options.objects);
  return inputs;
}

absl::Status view_one(const PanoramaViewOptions& options, const ViewScene& scene, JsonOutput& json) {
  const absl::Status apart =
      check_outputs_apart(inputs_of(options), {{options.output, "the image"},
                                               {options.verify.error_map, "the error map"},
                                               {options.json, "the JSON"}});
  if (!apart.ok()) return apart;
  for (const std::string& path : {options.output, options.verify.error_map}) {
    if (path.empty()) continue;
    RETURN_IF_ERROR(make_folder_of(path));
    if (const auto kind = check_output_path(path); !kind.ok()) return kind.status();
  }
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  RunDisplay display(options.quiet, json, progress);
  const absl::StatusOr<RenderReport> report = render_view(options, scene, display);
  progress.clear();
  if (!report.ok()) return about_input(report.status(), options.panorama);
  return tell(*report, options.quiet, options.verbose, json);
}

// Checks the files of a sequence before the work, and makes its folder. Returns the images.
absl::StatusOr<std::vector<std::string>> prepare_sequence(const PanoramaViewOptions& options,
                                                          uint64_t frames) {
  ASSIGN_OR_RETURN(const OutputNames names,
                   OutputNames::parse(options.output, output_encoding(options.encoding).extension()));
  std::vector<std::string> images;
  std::vector<OutputFile> outputs = {{options.json, "the JSON"}, {options.plot, "the plot"}};
  for (uint64_t i = 0; i < frames; ++i) {
    images.push_back(names.path(static_cast<int64_t>(i), ""));
    outputs.push_back({images.back(), "the images"});
  }
  RETURN_IF_ERROR(check_outputs_apart(inputs_of(options), outputs));
  if (!options.plot.empty()) {
    RETURN_IF_ERROR(check_plot(options.plot));
  }
  RETURN_IF_ERROR(make_folder_of(images.front()));
  return images;
}

absl::Status view_sequence(const PanoramaViewOptions& options, const ViewScene& scene, JsonOutput& json) {
  ASSIGN_OR_RETURN(const std::vector<std::string> images, prepare_sequence(options, scene.frames()));
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  RunDisplay display(options.quiet, json, progress);
  const absl::StatusOr<RunSummary> summary = render_views(options, scene, images, display);
  progress.clear();
  if (!summary.ok()) return about_input(summary.status(), options.panorama);
  if (!options.plot.empty()) {
    RETURN_IF_ERROR(plot_exposure(summary->curve, options.plot));
  }
  if (!options.quiet) {
    std::set<std::string> notes = summary->notes;
    notes.insert(options.notes.begin(), options.notes.end());
    for (const std::string& note : notes) print_note(note);
    if (!json.to_stdout()) {
      RETURN_IF_ERROR(print(to_text(*summary, absl::StrFormat("%s .. %s", images.front(), images.back()))));
    }
  }
  RETURN_IF_ERROR(json.add(to_json(*summary)));
  return json.close();
}

absl::Status run_view(const PanoramaViewOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const ViewScene scene, ViewScene::open(options));
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  return options.is_sequence() ? view_sequence(options, scene, json) : view_one(options, scene, json);
}

constexpr char kViewExamples[] =
    "Examples:\n"
    "  candela view pano.hdr view.png --yaw 30 --pitch 10 --fov 70 --objects lookdev\n"
    "  candela view pano.hdr view.png --size 2560x1440 --resize 50%\n"
    "  candela view pano.hdr out/%04d.png --turn 360 --frames 240 --fps 24\n"
    "  candela view pano.exr out/%04d.png --path keys.json --exposure-plot exposure.svg";

Finish define_view(CLI::App& app) {
  const auto arguments = std::make_shared<PanoramaViewArguments>();
  add_panorama_view_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_panorama_view_options(*arguments));
    PanoramaViewOptions& options = arguments->options;
    add_idle_notes(options,
                   {.given = given,
                    .encoding = encoding_of(options.output, options.encoding),
                    .view = !options.view.config.empty(),
                    .adapts = options.is_sequence() || options.previous.exposure() > 0,
                    .elapsed_seconds = options.is_sequence() ? std::numeric_limits<double>::infinity()
                                                             : options.previous.elapsed_seconds()});
    return parsed_command(options, run_view);
  };
}

}  // namespace

const Command kViewCommand{"view", "Renders a view of a panorama, or a sequence with a moving camera.",
                           kViewExamples, define_view};

}  // namespace candela
