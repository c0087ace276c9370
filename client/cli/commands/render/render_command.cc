#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/image_run.h"
#include "client/cli/commands/render/gamut_note.h"
#include "client/cli/commands/render/held_exposure.h"
#include "client/cli/commands/render/render_batch.h"
#include "client/cli/commands/render/render_report.h"
#include "client/cli/files/error_map.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/output_files.h"
#include "client/cli/files/sequence/frame_alpha.h"
#include "client/cli/files/sequence/frame_files.h"
#include "client/cli/files/sequence/sequence_files.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/render_options.h"
#include "client/cli/options/words/option_words.h"
#include "client/color/view_error.h"
#include "client/image/image.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Ends the wait for a server that never answers. The largest frame behind a full queue takes much less time.
constexpr absl::Duration kRenderTimeout = absl::Minutes(30);

// Renders one file: reads it, has the server render it, and writes the result.
class Rendering {
 public:
  // `only` says that no other image follows: the server is stopped before the image is written.
  Rendering(const RenderOptions& options, const RenderJob& job, bool only, ImageRun& run, Progress& progress)
      : options_(options), job_(job), only_(only), run_(run), progress_(progress) {}

  absl::StatusOr<RenderReport> run() {
    report_.input = job_.input;
    report_.output = job_.output;
    report_.error_map = options_.verify.error_map;
    report_.metered = options_.settings.exposure().mode() != v1::Exposure::MODE_MANUAL && !run_.locked();
    report_.notes = options_.notes;
    report_.curve = curve_word(options_.settings);
    report_.defaults = options_.defaults;
    if (run_.view()) {
      report_.view = run_.view()->report;
      report_.curve = report_.view->view;
      add_notes(run_.view()->notes);
    }
    ASSIGN_OR_RETURN(Image image, read());
    report_.primaries = primaries_of(image, options_.settings, view());
    report_.missing_pixels = image.missing_pixels;
    ASSIGN_OR_RETURN(Image picture, render(std::move(image)));
    RETURN_IF_ERROR(write(picture));
    RETURN_IF_ERROR(write_error_map());
    report_.total_ms = ms_since(begin_);
    return std::move(report_);
  }

 private:
  absl::StatusOr<Image> read_input() {
    ASSIGN_OR_RETURN(const v1::Limits limits, run_.limits());
    absl::StatusOr<Image> image =
        read_image(job_.input, image_limits(limits, options_), choice_of(options_, view()));
    if (!image.ok()) return image;
    if (verifies_view() && view()->view.to_scene) {
      const std::span<const std::byte> values = image->pixels.span();
      own_values_.assign(values.begin(), values.end());
    }
    enter_scene(view(), *image);
    return image;
  }

  const BakedView* view() const { return run_.view() ? &*run_.view() : nullptr; }
  // Numbers, which no gamut cuts.
  bool shows_data() const { return view() != nullptr && view()->view.as_is; }
  bool verifies_view() const { return options_.verify.verify && view() != nullptr; }

  absl::StatusOr<Image> read() {
    progress_.show("reading " + job_.input);
    if (const auto limits = run_.limits(); !limits.ok()) return limits.status();
    const absl::Time begin = absl::Now();
    absl::StatusOr<Image> image = read_input();
    read_ms_ = ms_since(begin);
    if (!image.ok()) return image;
    add_notes(std::exchange(image->notes, {}));
    add_note(cube_map_note(*image));
    return image;
  }

  // Frees the frame, and stops the built-in server after the only image, before it returns, so that only the
  // picture stays in memory.
  absl::StatusOr<Image> render(Image frame) {
    progress_.show("rendering " + job_.input);
    RETURN_IF_ERROR(run_.connect());
    const absl::Time begin = absl::Now();
    FrameView view = view_of(frame);
    if (options_.previous.exposure() > 0) view.previous = options_.previous;
    view.exposure = run_.locked();
    view.verify = options_.verify.verify;
    view.error_map = !options_.verify.error_map.empty();
    // The picture will need the memory.
    if (only_ && !verifies_view()) view.on_sent = [&frame] { frame.pixels = {}; };
    v1::Settings settings = settings_for(frame, options_.settings);
    if (options_.ignore_empty_alpha) add_note(ignore_empty_alpha(frame, settings));
    const bool alpha = frame.has_alpha && keeps_alpha(settings);
    if (run_.view()) show_by(*run_.view(), settings);
    report_.tone_curve = settings.curve();
    absl::StatusOr<RenderResult> result = call(settings, frame, view, begin + kRenderTimeout);
    const double call_ms = ms_since(begin);
    if (!result.ok()) return name_file(in_options(result.status(), options_.settings), job_.input);
    if (only_) run_.close();

    report_.header = result->header;
    if (!run_.locked()) {
      add_note(held_words(report_.header.target(), report_.header.target_before_limits()));
    }
    if (!shows_data()) add_note(gamut_note(report_.header, settings).value_or(""));
    if (verifies_view()) {
      const std::span<const std::byte> own = own_values_.empty() ? view.pixels : own_values_;
      ASSIGN_OR_RETURN(const ViewError error,
                       error_of_view(run_.view()->view, {view.format, own, std::move(settings),
                                                         result->header, result->pixels()}));
      report_.view_error = error;
      frame.pixels = {};
    }
    error_map_ = std::move(result->error_map);
    add_stages(call_ms);
    absl::StatusOr<Image> picture = picture_of(*result, alpha, frame.pixel_aspect);
    if (picture.ok()) {
      picture->frame_rate = frame.frame_rate;
      picture->kept = frame.kept;
    }
    return picture;
  }

  absl::StatusOr<RenderResult> call(const v1::Settings& settings, Image& frame, FrameView& view,
                                    absl::Time deadline) {
    absl::StatusOr<RenderResult> result;
    RETURN_IF_ERROR(run_.link().call(deadline, [&](const Connection& server) {
      RETURN_IF_ERROR(read_again(frame, view));
      result = call_once(server, settings, view, deadline);
      return result.status();
    }));
    return result;
  }

  // Several images at once may be too many for the server's memory. Then this one waits for another one's
  // call to end.
  absl::StatusOr<RenderResult> call_once(const Connection& server, const v1::Settings& settings,
                                         const FrameView& view, absl::Time deadline) {
    while (true) {
      run_.begin_call();
      absl::StatusOr<RenderResult> result = server.render(settings, view, deadline);
      run_.end_call();
      if (only_ || !absl::IsUnavailable(result.status()) || !run_.wait_for_a_call()) return result;
    }
  }

  // The call that sent the frame was lost, and the frame was freed by then.
  absl::Status read_again(Image& frame, FrameView& view) {
    if (!frame.pixels.empty()) return absl::OkStatus();
    absl::StatusOr<Image> image = read_input();
    if (!image.ok()) return image.status();
    if (image->width != frame.width || image->height != frame.height || image->format != frame.format) {
      return failure_of(FailureKind::kInput, absl::FailedPreconditionError(absl::StrFormat(
                                                 "%s: it was replaced by another image while it was "
                                                 "rendered; render it again",
                                                 job_.input)));
    }
    frame.pixels = std::move(image->pixels);
    view.pixels = frame.pixels.span();
    return absl::OkStatus();
  }

  absl::Status write(const Image& picture) {
    progress_.show("writing " + job_.output);
    const absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(std::vector<std::string> notes, write_image(job_.output, picture, options_.write));
    report_.stage_ms.emplace_back("write", ms_since(begin));
    add_notes(std::move(notes));
    return absl::OkStatus();
  }

  absl::Status write_error_map() {
    if (options_.verify.error_map.empty()) return absl::OkStatus();
    progress_.show("writing " + options_.verify.error_map);
    return candela::write_error_map(options_.verify.error_map, error_map_, report_.header.width(),
                                    report_.header.height());
  }

  void add_notes(std::vector<std::string> notes) {
    std::move(notes.begin(), notes.end(), std::back_inserter(report_.notes));
  }

  void add_note(std::string note) {
    if (!note.empty()) report_.notes.push_back(std::move(note));
  }

  void add_stages(double call_ms) {
    if (run_.start_ms() > 0) report_.stage_ms.emplace_back("start", run_.start_ms());
    if (report_.view) report_.stage_ms.emplace_back("view", run_.bake_ms());
    report_.stage_ms.emplace_back("read", read_ms_);
    double server_ms = 0;
    for (const v1::StageTime& stage : report_.header.stages()) {
      const double ms = static_cast<double>(stage.ns()) * 1e-6;
      report_.stage_ms.emplace_back(stage.name(), ms);
      server_ms += ms;
    }
    report_.stage_ms.emplace_back("other", std::max(0.0, call_ms - server_ms));
  }

  const absl::Time begin_ = absl::Now();
  const RenderOptions& options_;
  const RenderJob& job_;
  const bool only_;
  ImageRun& run_;
  Progress& progress_;
  RenderReport report_;
  std::vector<uint16_t> error_map_;
  std::vector<std::byte> own_values_;  // the file's, if they are not what is sent and the view is verified
  double read_ms_ = 0;
};

// Checks the files to write before the work, and makes their folders.
absl::Status prepare_outputs(const RenderOptions& options, const std::vector<RenderJob>& jobs) {
  std::vector<std::string> inputs = files_of(options.server);
  inputs.insert(inputs.end(), {options.view.config, options.locked_exposure});
  std::vector<OutputFile> outputs;
  for (const RenderJob& job : jobs) {
    inputs.push_back(job.input);
    outputs.push_back({job.output, "the image"});
  }
  outputs.push_back({options.verify.error_map, "the error map"});
  outputs.push_back({options.json, "the JSON"});
  RETURN_IF_ERROR(check_outputs_apart(inputs, outputs));
  for (const std::string& path : {jobs.front().output, options.verify.error_map}) {
    if (path.empty()) continue;
    RETURN_IF_ERROR(make_folder_of(path));
    if (const auto kind = check_output_path(path); !kind.ok()) return kind.status();
  }
  return absl::OkStatus();
}

absl::Status render_one(const RenderOptions& options, const RenderJob& job, JsonOutput& json,
                        Progress& progress) {
  ImageRun run(options);
  if (!options.view.config.empty()) progress.show("baking " + options.view.config);
  RETURN_IF_ERROR(run.read_exposure());
  RETURN_IF_ERROR(run.bake());
  const absl::StatusOr<RenderReport> report = Rendering(options, job, true, run, progress).run();
  progress.clear();
  if (!report.ok()) return about_input(report.status(), job.input);
  if (!options.quiet) {
    for (const std::string& note : notes_for_user(*report)) print_note(note);
    if (!json.to_stdout()) {
      RETURN_IF_ERROR(print(to_text(*report, options.verbose)));
    }
  }
  return json.write(to_json(*report));
}

absl::Status render_folder(const RenderOptions& options, const std::vector<RenderJob>& jobs, JsonOutput& json,
                           Progress& progress) {
  ImageRun run(options);
  if (!options.view.config.empty()) progress.show("baking " + options.view.config);
  RETURN_IF_ERROR(run.read_exposure());
  RETURN_IF_ERROR(run.bake());
  const auto render = [&](const RenderJob& job) {
    Progress silent(false);
    return Rendering(options, job, false, run, silent).run();
  };
  return render_batch(
      options, jobs, render, [&run] { return run.failure(); }, json, progress);
}

absl::Status run_render(const RenderOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const RenderPlan plan, plan_render(options));
  const std::vector<RenderJob>& jobs = plan.jobs;
  RETURN_IF_ERROR(prepare_outputs(options, jobs));
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  if (!plan.hidden.empty() && !options.quiet) print_note("left out: " + words_of_hidden(plan.hidden));
  return options.extension.empty() ? render_one(options, jobs.front(), json, progress)
                                   : render_folder(options, jobs, json, progress);
}

constexpr char kRenderExamples[] =
    "Examples:\n"
    "  candela render in.exr out.png\n"
    "  candela render in.hdr out.png --exposure -2 --curve aces-narkowicz --bits 16\n"
    "  candela render a.exr b.hdr 'more/*.exr' out/ --as jpg\n"
    "  candela render in.exr out.jpg --server 127.0.0.1:50051 --json -";

Finish define_render(CLI::App& app) {
  const auto arguments = std::make_shared<RenderArguments>();
  add_render_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_render_options(*arguments));
    RenderOptions& options = arguments->options;
    add_idle_notes(options, {.given = given,
                             .encoding = encoding_of(options.extension.empty() ? options.output
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
