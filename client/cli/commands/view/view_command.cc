// `candela view`: a picture of a panorama, or a sequence of them.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/commands/commands.h"
#include "client/cli/files/exposure_plot.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/panorama/view_arguments.h"
#include "client/cli/results/render_report.h"
#include "client/cli/results/run_display.h"
#include "client/cli/results/stream_report.h"
#include "client/image/encodings.h"
#include "client/run/output_files.h"
#include "client/run/sequence.h"
#include "client/run/view_run.h"
#include "client/run/view_scene.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

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
