// `candela view`: a picture of a panorama, or a sequence of them.
#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/render/gamut_note.h"
#include "client/cli/commands/render/held_exposure.h"
#include "client/cli/commands/render/render_report.h"
#include "client/cli/commands/server_link.h"
#include "client/cli/environment/panorama_file.h"
#include "client/cli/environment/panorama_options.h"
#include "client/cli/environment/view_objects.h"
#include "client/cli/environment/view_scene.h"
#include "client/cli/environment/view_sequence.h"
#include "client/cli/files/error_map.h"
#include "client/cli/files/exposure_file.h"
#include "client/cli/files/exposure_plot.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/output_files.h"
#include "client/cli/files/sequence/frame_files.h"
#include "client/cli/files/sequence/sequence_files.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/words/option_words.h"
#include "client/image/encodings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Ends the wait for a server that never answers.
constexpr absl::Duration kViewTimeout = absl::Minutes(30);

// Renders one view and writes it.
class OneView {
 public:
  OneView(const PanoramaViewOptions& options, const ViewScene& scene, Progress& progress)
      : options_(options), scene_(scene), progress_(progress), link_(options.server, options.quiet) {}

  absl::StatusOr<RenderReport> run() {
    report_.input = options_.panorama;
    report_.output = options_.output;
    report_.error_map = options_.verify.error_map;
    report_.metered =
        options_.settings.exposure().mode() != v1::Exposure::MODE_MANUAL && options_.locked_exposure.empty();
    report_.notes = options_.notes;
    report_.curve = curve_word(options_.settings);
    report_.tone_curve = options_.settings.curve();
    report_.defaults = options_.defaults;
    absl::Status status = bake_view();
    if (status.ok()) status = read();
    if (status.ok()) status = connect();
    if (!status.ok()) return status;
    ASSIGN_OR_RETURN(Image picture, render());
    if (status = write(picture); !status.ok()) return status;
    if (status = draw_error(); !status.ok()) return status;
    report_.total_ms = ms_since(begin_);
    return std::move(report_);
  }

 private:
  absl::Status bake_view() {
    settings_ = without_panorama(options_.settings);
    frame_.width = options_.width;
    frame_.height = options_.height;
    frame_.verify = options_.verify.verify;
    frame_.error_map = !options_.verify.error_map.empty();
    if (options_.previous.exposure() > 0) frame_.previous = options_.previous;
    if (!options_.locked_exposure.empty()) {
      ASSIGN_OR_RETURN(const ExposureFile file, read_exposures(options_.locked_exposure));
      frame_.exposure = file.locked;
    }
    if (options_.view.config.empty()) return absl::OkStatus();
    progress_.show("baking " + options_.view.config);
    const absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(BakedView baked, bake(options_));
    report_.stage_ms.emplace_back("ocio", ms_since(begin));
    report_.view = baked.report;
    report_.curve = baked.report.view;
    add_notes(baked.notes);
    show_by(baked, settings_);
    report_.tone_curve = settings_.curve();
    view_ = std::move(baked);
    return absl::OkStatus();
  }

  absl::Status read() {
    progress_.show("reading " + options_.panorama);
    ASSIGN_OR_RETURN(const v1::Limits limits, link_.limits());
    const absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(PanoramaFile file,
                     read_panorama(options_.panorama, options_, limits, view_ ? &*view_ : nullptr));
    report_.stage_ms.emplace_back("read", ms_since(begin));
    report_.primaries = file.primaries;
    report_.missing_pixels = file.missing_pixels;
    add_notes(std::exchange(file.notes, {}));
    panorama_ = std::move(file.panorama);
    return absl::OkStatus();
  }

  // Waits for the built-in server.
  absl::Status connect() {
    if (const auto server = link_.connection(); !server.ok()) return server.status();
    if (link_.start_ms() > 0) report_.stage_ms.emplace_back("start", link_.start_ms());
    return link_.check_tier(options_.settings.tier());
  }

  absl::StatusOr<Image> render() {
    const absl::Time deadline = absl::Now() + kViewTimeout;
    absl::StatusOr<RenderResult> result;
    const absl::Status status = link_.call(deadline, [&](const Connection& server) {
      result = render_on(server, deadline);
      return result.status();
    });
    if (!status.ok()) return name_file(in_options(status, options_.settings), options_.panorama);
    panorama_.reset();
    link_.close();
    add_note(bad_values_);
    report_.header = result->header;
    error_map_ = std::move(result->error_map);
    if (!frame_.exposure)
      add_note(held_words(result->header.target(), result->header.target_before_limits()));
    if (!view_ || !view_->view.as_is) add_note(gamut_note(result->header, settings_).value_or(""));
    return picture_of(*result, /*has_alpha=*/false, /*pixel_aspect=*/1);
  }

  // Both calls go to the same server, because another one may not have the panorama.
  absl::StatusOr<RenderResult> render_on(const Connection& server, absl::Time deadline) {
    progress_.show("sending " + options_.panorama);
    absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(const v1::Environment environment, server.put_environment(*panorama_, deadline));
    report_.environment = environment.id();
    bad_values_ = bad_values_note(environment);
    const double put_ms = ms_since(begin);
    progress_.show(
        absl::StrFormat("rendering %s; the first view of a panorama takes longer", options_.output));
    begin = absl::Now();
    FrameView frame = frame_;
    frame.view = scene_.view(environment.id(), 0);
    absl::StatusOr<RenderResult> result = server.render(settings_, frame, deadline);
    if (result.ok()) add_stages(put_ms, ms_since(begin), result->header);
    return result;
  }

  absl::Status write(const Image& picture) {
    progress_.show("writing " + options_.output);
    const absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(std::vector<std::string> notes, write_image(options_.output, picture, options_.write));
    report_.stage_ms.emplace_back("write", ms_since(begin));
    add_notes(std::move(notes));
    return absl::OkStatus();
  }

  absl::Status draw_error() {
    if (options_.verify.error_map.empty()) return absl::OkStatus();
    progress_.show("writing " + options_.verify.error_map);
    return write_error_map(options_.verify.error_map, error_map_, options_.width, options_.height);
  }

  void add_stages(double put_ms, double call_ms, const v1::ResultHeader& header) {
    report_.stage_ms.emplace_back("put", put_ms);
    double server_ms = 0;
    for (const v1::StageTime& stage : header.stages()) {
      const double ms = static_cast<double>(stage.ns()) * 1e-6;
      report_.stage_ms.emplace_back(stage.name(), ms);
      server_ms += ms;
    }
    report_.stage_ms.emplace_back("other", std::max(0.0, call_ms - server_ms));
  }

  void add_notes(std::vector<std::string> notes) {
    std::move(notes.begin(), notes.end(), std::back_inserter(report_.notes));
  }
  void add_note(std::string note) {
    if (!note.empty()) report_.notes.push_back(std::move(note));
  }

  const absl::Time begin_ = absl::Now();
  const PanoramaViewOptions& options_;
  const ViewScene& scene_;
  Progress& progress_;
  ServerLink link_;
  v1::Settings settings_;
  FrameView frame_;
  std::optional<BakedView> view_;
  std::shared_ptr<const Panorama> panorama_;
  std::string bad_values_;  // a note about the panorama's, or ""
  std::vector<uint16_t> error_map_;
  RenderReport report_;
};

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
  const absl::StatusOr<RenderReport> report = OneView(options, scene, progress).run();
  progress.clear();
  if (!report.ok()) return about_input(report.status(), options.panorama);
  if (!options.quiet) {
    for (const std::string& note : notes_for_user(*report)) print_note(note);
    if (!json.to_stdout()) {
      RETURN_IF_ERROR(print(to_text(*report, options.verbose)));
    }
  }
  return json.write(to_json(*report));
}

// Checks the files of a sequence before the work, and makes its folder.
absl::StatusOr<std::string> prepare_sequence(const PanoramaViewOptions& options, uint64_t frames) {
  ASSIGN_OR_RETURN(const OutputNames names,
                   OutputNames::parse(options.output, output_encoding(options.encoding).extension()));
  std::vector<OutputFile> outputs = {{options.json, "the JSON"}, {options.plot, "the plot"}};
  for (uint64_t i = 0; i < frames; ++i) outputs.push_back({names.path(i, ""), "the images"});
  RETURN_IF_ERROR(check_outputs_apart(inputs_of(options), outputs));
  if (!options.plot.empty()) {
    RETURN_IF_ERROR(check_plot(options.plot));
  }
  RETURN_IF_ERROR(make_folder_of(names.path(0, "")));
  return absl::StrFormat("%s .. %s", names.path(0, ""), names.path(frames - 1, ""));
}

absl::Status view_sequence(const PanoramaViewOptions& options, const ViewScene& scene, JsonOutput& json) {
  ASSIGN_OR_RETURN(const std::string where, prepare_sequence(options, scene.frames()));
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  const absl::StatusOr<StreamSummary> summary = render_view_sequence(options, scene, json, progress);
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
      RETURN_IF_ERROR(print(to_text(*summary, where)));
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
