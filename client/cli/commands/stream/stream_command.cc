#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <cstdio>
#include <limits>
#include <memory>
#include <set>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/base/failure.h"
#include "client/base/usage.h"
#include "client/cli/commands/commands.h"
#include "client/cli/files/exposure_plot.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/sequence/stream_options.h"
#include "client/cli/results/run_display.h"
#include "client/cli/results/stream_report.h"
#include "client/image/encodings.h"
#include "client/image/write/standard_output.h"
#include "client/run/exposure_file.h"
#include "client/run/output_files.h"
#include "client/run/sequence_run.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMostNotes = 5;

// Where the images are; "": there are none.
std::string places_of(const StreamOptions& options, const StreamPlan& plan, const RunSummary& summary) {
  if (options.film) return options.output;
  if (options.pipe) return kStdoutName;
  if (!plan.names) return "";
  const auto at = [&](int64_t number, uint64_t place) {
    FrameFacts frame;
    frame.number = number;
    frame.place = place;
    return output_of(options, plan, frame);
  };
  const size_t images = plan.images.empty() ? plan.sequence.frames.size() : plan.images.size();
  return absl::StrFormat("%s .. %s", at(summary.first, 0), at(summary.last, images - 1));
}

// What ffmpeg is started with, for a shell. A film's file has its name only at the end.
std::string command_line(const StreamOptions& options) {
  std::string line;
  const WriteOptions& write = options.write;
  for (const std::string& word : film_command(*options.film, write.transfer, write.hdr, options.output)) {
    const bool plain = word.find_first_not_of(
                           "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                           "-_=:+./,") == std::string::npos;
    absl::StrAppend(&line, line.empty() ? "" : " ",
                    plain ? word : "'" + absl::StrReplaceAll(word, {{"'", "'\\''"}}) + "'");
  }
  return line;
}

// Prints the notes and the summary: on stderr, if frames go to stdout.
absl::Status tell(const StreamOptions& options, const RunSummary& summary, const std::string& where,
                  bool json_to_stdout) {
  if (options.quiet) return absl::OkStatus();
  std::set<std::string> notes = summary.notes;
  notes.insert(options.notes.begin(), options.notes.end());
  size_t told = 0;
  for (const std::string& note : notes) {
    if (told++ < kMostNotes) print_note(note);
  }
  if (told > kMostNotes) print_note(absl::StrFormat("and %d more notes", told - kMostNotes));
  if (summary.reader_left) {
    const uint64_t frames = summary.written + summary.held;
    print_note(absl::StrFormat("whoever read standard output stopped after %d frame%s, and so did this",
                               frames, frames == 1 ? "" : "s"));
  }
  if (options.to_stdout()) std::fputs(to_text(summary, where).c_str(), stderr);
  return json_to_stdout || options.to_stdout() ? absl::OkStatus() : print(to_text(summary, where));
}

constexpr char kStreamExamples[] =
    "Examples:\n"
    "  candela stream 'in/*.exr' out/%04d.png --fps 24\n"
    "  candela stream in out --lookahead 4 --detect-cuts --exposure-plot exposure.svg\n"
    "  candela stream in out --server 127.0.0.1:50051,127.0.0.1:50052 --json frames.json\n"
    "  candela stream 'in/shot.####.exr' review.mp4 --fps 24 -v\n"
    "  ffmpeg -i in.mov -f image2pipe -c:v phm - | candela stream - - --fps 24 | ffmpeg -i - out.mp4";

Finish define_stream(CLI::App& app) {
  const auto arguments = std::make_shared<StreamArguments>();
  add_stream_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_stream_options(*arguments));
    StreamOptions& options = arguments->options;
    add_idle_notes(options, {.given = given,
                             .encoding = options.pipe ? &piped_encoding(options.pipe->kind)
                                                      : encoding_of(options.output, options.encoding),
                             .view = !options.view.config.empty(),
                             .adapts = true,
                             .elapsed_seconds = std::numeric_limits<double>::infinity()});
    return parsed_command(options, run_stream);
  };
}

}  // namespace

absl::Status run_stream(const StreamOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const ShotExposures shot, ShotExposures::open(options));
  ASSIGN_OR_RETURN(StreamPlan plan, plan_stream(options, shot));
  const Sequence& sequence = plan.sequence;
  const bool wants_exposures = shot.saved() || !options.plot.empty();
  if (sequence.frames.empty() && !options.from_stdin() && wants_exposures) {
    return usage_error(
        "every image repeats a frame before --range, so there are no exposures to save or to draw; leave out "
        "--save-exposures and --exposure-plot, or give another --range");
  }
  RETURN_IF_ERROR(shot.prepare_save());
  if (!options.plot.empty()) {
    RETURN_IF_ERROR(check_plot(options.plot));
  }
  RETURN_IF_ERROR(json.open());
  if (options.to_stdout()) {
    RETURN_IF_ERROR(check_stdout(json));
  }
  if (options.film) {
    RETURN_IF_ERROR(make_folder_of(options.output));
  }
  if (plan.names) {
    RETURN_IF_ERROR(make_folder_of(plan.names->path(0, "")));
  }
  if (!options.quiet) {
    for (const std::string& note : sequence.notes) print_note(note);
    if (options.film && options.verbose) print_note(command_line(options));
  }
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  RunDisplay display(options.quiet, json, progress);
  const absl::StatusOr<RunSummary> summary = render_sequence(options, shot, plan, display);
  progress.clear();
  if (!summary.ok()) return summary.status();
  if (summary->reader_left && wants_exposures) {
    return failure_of(FailureKind::kOutput,
                      absl::AbortedError("whoever read standard output stopped before the last frame, so "
                                         "there are no exposures of all frames to save or to draw"));
  }
  if (summary->curve.empty() && wants_exposures) {
    return failure_of(
        FailureKind::kInput,
        absl::NotFoundError("no frame of its own was rendered, so there is no exposure to save or "
                            "to draw"));
  }
  if (shot.saved()) {
    RETURN_IF_ERROR(shot.save(sequence, summary->rate.rate, summary->curve, summary->state));
  }
  if (!options.plot.empty()) {
    RETURN_IF_ERROR(plot_exposure(summary->curve, options.plot));
  }
  RETURN_IF_ERROR(tell(options, *summary, places_of(options, plan, *summary), json.to_stdout()));
  RETURN_IF_ERROR(json.add(to_json(*summary)));
  return json.close();
}

const Command kStreamCommand{"stream", "Renders a sequence of frames with exposure that adapts over time.",
                             kStreamExamples, define_stream};

}  // namespace candela
