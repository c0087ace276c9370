#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/base/usage.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/render/render_batch.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/contact_options.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/results/run_display.h"
#include "client/image/encodings.h"
#include "client/run/images/contact_sheet.h"
#include "client/run/output_files.h"
#include "client/run/picture_run.h"
#include "client/run/run.h"
#include "client/run/sequence.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// "frame 7  +1.23 EV"; without a number at the end of the name, after a dot, a line or a dash, only the
// exposure.
std::string words_below(const std::string& input, const RenderReport& report) {
  const std::string stem = std::filesystem::path(input).stem().string();
  const size_t begin = stem.find_last_not_of("0123456789") + 1;  // 0 if all are digits
  const bool apart = begin == 0 || absl::StrContains("._-", stem.substr(begin - 1, 1));
  std::string words = apart && begin < stem.size() && stem.size() - begin < 10
                          ? absl::StrFormat("frame %d  ", std::atoll(stem.c_str() + begin))
                          : "";
  return words + with_sign(std::log2(report.header.exposure()), 2) + " EV";
}

absl::Status run_contact(const ContactOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const FoundFiles files, render_inputs(options.inputs));
  std::vector<RenderJob> jobs;
  for (const std::string& path : files.paths) jobs.push_back({path, options.output});
  std::vector<std::string> inputs = files_of(options.server);
  inputs.insert(inputs.end(), {options.view.config, options.locked_exposure});
  inputs.insert(inputs.end(), files.paths.begin(), files.paths.end());
  RETURN_IF_ERROR(check_outputs_apart(inputs, {{options.output, "the sheet"}, {options.json, "the JSON"}}));
  RETURN_IF_ERROR(make_folder_of(options.output));
  if (const auto kind = check_output_path(options.output); !kind.ok()) return kind.status();
  RETURN_IF_ERROR(json.open());
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  if (!files.hidden.empty() && !options.quiet) print_note("left out: " + words_of_hidden(files.hidden));
  RunDisplay display(options.quiet, json, progress);
  Run run(options, display);
  RETURN_IF_ERROR(run.read_exposure());
  RETURN_IF_ERROR(run.bake());

  std::vector<SheetPicture> pictures(jobs.size());
  for (size_t i = 0; i < jobs.size(); ++i) {
    pictures[i].name = std::filesystem::path(jobs[i].input).filename().string();
    pictures[i].words = "failed";
    jobs[i].take = [&picture = pictures[i].picture](Image image) { picture = std::move(image); };
  }
  const auto render = [&](const RenderJob& job) {
    RunEvents silent;
    absl::StatusOr<RenderReport> report = run_frame(options, job, /*only=*/false, run, silent);
    if (report.ok()) pictures[&job - jobs.data()].words = words_below(job.input, *report);
    return report;
  };
  const auto write_sheet = [&]() -> absl::Status {
    ASSIGN_OR_RETURN(const Image sheet, make_contact_sheet(pictures, options.columns));
    return write_image(options.output, sheet, options.write).status();
  };
  return render_batch(
      options, jobs, render, [&run] { return run.failure(); }, json, progress, write_sheet);
}

constexpr char kContactExamples[] =
    "Examples:\n"
    "  candela contact 'shot/*.exr' sheet.png\n"
    "  candela contact library/ sheet.jpg --columns 8 --exposure 0";

Finish define_contact(CLI::App& app) {
  const auto arguments = std::make_shared<ContactArguments>();
  add_contact_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_contact_options(*arguments));
    ContactOptions& options = arguments->options;
    add_idle_notes(
        options,
        {.given = given, .encoding = encoding_of(options.output), .view = !options.view.config.empty()});
    return parsed_command(options, run_contact);
  };
}

}  // namespace

const Command kContactCommand{"contact", "Puts many images onto one sheet, with names and exposures.",
                              kContactExamples, define_contact};

}  // namespace candela
