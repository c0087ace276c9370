#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <memory>
#include <thread>
#include <vector>

#include "client/base/failure.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/render/render_batch.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/render_options.h"
#include "client/cli/results/render_report.h"
#include "client/cli/results/run_display.h"
#include "client/image/encodings.h"
#include "client/run/output_files.h"
#include "client/run/picture_run.h"
#include "client/run/run.h"
#include "client/run/sequence.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

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
  if (!plan.hidden.empty() && !options.quiet) print_note("left out: " + words_of_hidden(plan.hidden));
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
