#include <OpenEXR/ImfThreading.h>

#include <CLI/App.hpp>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/cli/commands/commands.h"
#include "client/cli/commands/render/gamut_note.h"
#include "client/cli/commands/render/held_exposure.h"
#include "client/cli/commands/render/render_report.h"
#include "client/cli/commands/server_link.h"
#include "client/cli/commands/stream/held_images.h"
#include "client/cli/commands/stream/shot_exposures.h"
#include "client/cli/commands/stream/stream_images.h"
#include "client/cli/commands/stream/stream_plan.h"
#include "client/cli/commands/stream/stream_report.h"
#include "client/cli/files/exposure_plot.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/output_files.h"
#include "client/cli/files/sequence/frame_feeder.h"
#include "client/cli/files/sequence/frame_files.h"
#include "client/cli/files/sequence/frame_reader.h"
#include "client/cli/files/sequence/sequence.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/command_line.h"
#include "client/cli/options/idle_options.h"
#include "client/cli/options/sequence/stream_options.h"
#include "client/cli/options/usage.h"
#include "client/cli/options/words/option_words.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kReadAhead = 2;
constexpr size_t kMostNotes = 5;

std::vector<std::string> paths_of(const Sequence& sequence) {
  std::vector<std::string> paths;
  for (const SequenceFrame& frame : sequence.frames) paths.push_back(frame.path);
  return paths;
}

// The frames' own settings. The table is the session's, and too large to copy for each of them.
v1::Settings without_table(v1::Settings settings) {
  settings.clear_table();
  return settings;
}

// Renders a sequence: feeds its files to a session and writes the results, several at once.
class Streaming {
 public:
  Streaming(const StreamOptions& options, const ShotExposures& shot, const Sequence& sequence,
            const std::vector<NamedImage>& named, JsonOutput& json, Progress& progress)
      : options_(options),
        shot_(shot),
        sequence_(sequence),
        named_(named),
        progress_(progress),
        link_(options.server, options.quiet),
        images_(options.write, options.quiet, json, progress, summary_),
        held_(options, shot, sequence, link_, images_, summary_) {}

  absl::StatusOr<StreamSummary> run() {
    summary_.frames = sequence_.frames.size();
    summary_.first = sequence_.first();
    summary_.last = sequence_.last();
    summary_.missing = to_text(sequence_.missing);
    SessionOptions session;
    std::shared_ptr<const BakedView> view;
    RETURN_IF_ERROR(prepare(session.settings, view));
    ASSIGN_OR_RETURN(const v1::Limits limits, link_.limits());
    const ImageLimits files = image_limits(limits, options_);
    progress_.show("reading " + named_.front().input);
    FrameReader reader(paths_of(sequence_), files, kReadAhead, choice_of(options_, view.get()));
    const FeedOptions feed{.settings = without_table(session.settings),
                           .timeout = options_.timeout,
                           .skip_bad = options_.skip_bad,
                           .rate = shot_.rate(),
                           .view = view,
                           .ignore_empty_alpha = options_.ignore_empty_alpha,
                           .exposures = shot_.given()};
    FrameFeeder feeder(sequence_, feed, reader);
    const absl::StatusOr<const Image*> first = feeder.first();
    if (!first.ok()) return failure_of(FailureKind::kInput, first.status());
    summary_.rate = feeder.rate();
    if (shot_.fixes_rate()) summary_.rate.from = "exposures";
    session = session_options(std::move(session.settings));
    held_.begin(session, files, feed, feeder);
    absl::Status status = repeat_each(sequence_.holds_before.size(), 0);
    // Files at the beginning that could not be read.
    if (status.ok()) status = add_skipped(feeder, sequence_.frames.size());
    if (status.ok() && *first != nullptr) status = stream(**first, std::move(session), feeder);
    if (status.ok()) status = add_skipped(feeder, sequence_.frames.size());
    status.Update(images_.finish());
    status.Update(feeder.status());
    if (!status.ok()) return status;
    if (sequence_.cut_after) summary_.state.set_cut_pending(true);
    if (summary_.written + summary_.held == 0) {
      return failure_of(
          summary_.skipped_for.value_or(FailureKind::kOther),
          absl::InvalidArgumentError(absl::StrFormat(
              "none of the %d frames could be rendered; run without --skip-bad to see the first failure",
              sequence_.frames.size())));
    }
    summary_.locked = locked_exposure(options_.settings.exposure(), summary_.curve);
    summary_.saved = options_.save_exposures;
    return std::move(summary_);
  }

 private:
  absl::Status prepare(v1::Settings& settings, std::shared_ptr<const BakedView>& view) {
    settings = options_.settings;
    summary_.defaults = options_.defaults;
    if (!options_.view.config.empty()) {
      progress_.show("baking " + options_.view.config);
      ASSIGN_OR_RETURN(BakedView baked, bake(options_));
      show_by(baked, settings);
      summary_.notes.insert(baked.notes.begin(), baked.notes.end());
      summary_.view = view_words(baked.report);
      view = std::make_shared<const BakedView>(std::move(baked));
      shows_data_ = view->view.as_is;
    }
    return link_.check_tier(settings.tier());
  }

  SessionOptions session_options(v1::Settings settings) const {
    SessionOptions options;
    options.settings = std::move(settings);
    options.name = options_.session;
    options.lookahead = options_.lookahead;
    options.cut_threshold_ev = options_.cut_threshold_ev;
    options.encoding = options_.encoding;
    options.state = shot_.state();
    options.return_state = shot_.saved();
    options.jpeg_quality = static_cast<uint32_t>(options_.write.jpeg_quality);
    return options;
  }

  absl::Status stream(const Image& first, SessionOptions options, FrameFeeder& feeder) {
    options.settings = settings_for(first, std::move(options.settings));
    settings_ = options.settings;
    progress_.show("opening a session");
    absl::StatusOr<Session> session = link_.open_session(options);
    if (!session.ok()) return in_options(session.status(), options_.settings);
    begin_ = absl::Now();
    feeder.start(*session, options.settings);
    // The feeder uses the session until its end, which may also come by an exception.
    const absl::Cleanup stop_feeding = [&] {
      session->cancel();
      feeder.join();
    };
    absl::Status status = take_results(*session, feeder);
    if (!status.ok()) session->cancel();
    // The feeder ends after the last file, or when submit() fails.
    feeder.join();
    if (status.ok()) status = images_.finish();
    summary_.time = absl::Now() - begin_;
    summary_.session = session->stats();
    summary_.notes.merge(feeder.take_notes());
    return status;
  }

  absl::Status take_results(Session& session, FrameFeeder& feeder) {
    while (true) {
      absl::StatusOr<std::optional<FrameResult>> result = session.next_result();
      if (!result.ok()) return in_options(result.status(), options_.settings);
      if (!*result) return absl::OkStatus();
      tell_of_resume(session);
      const size_t index = sequence_.index_of((*result)->sequence);
      RETURN_IF_ERROR(add_skipped(feeder, index));
      RETURN_IF_ERROR(take(index, **result, feeder.take_facts(index)));
      show(index);
    }
  }

  absl::Status take(size_t index, FrameResult& result, const FrameFacts& facts) {
    StreamFrame frame = frame_of(index);
    if (!result.status.ok()) {
      frame.status = name_file(in_options(result.status, options_.settings), frame.input);
      if (!options_.skip_bad) return frame.status;
      return skip(index, std::move(frame));
    }
    frame.header = result.image.header;
    frame.primaries = facts.primaries;
    frame.missing_pixels = facts.missing_pixels;
    summary_.primaries.insert(words_of(facts.primaries));
    frame.latency = result.latency;
    exposure_ = frame.header.exposure();
    add_notes_on(frame);
    summary_.curve.push_back({.frame = frame.number,
                              .media_time_ns = frame.media_time_ns,
                              .exposure = exposure_,
                              .target = frame.header.target(),
                              .mean_log2_luminance = frame.header.statistics().mean_log2_luminance(),
                              .cut = frame.header.cut()});
    summary_.state = frame.header.state();
    held_.has_image(frame.number, frame.input);
    if (absl::Status status = images_.write(std::move(frame), std::move(result.image), facts); !status.ok()) {
      return status;
    }
    return repeat_after(index);
  }

  // Once a session, because the numbers are others for each frame.
  void add_notes_on(const StreamFrame& frame) {
    const auto say_once = [&](bool& said, const std::string& words) {
      if (!words.empty() && !std::exchange(said, true)) summary_.notes.insert(frame.input + ": " + words);
    };
    const v1::FrameStatistics& statistics = frame.header.statistics();
    say_once(said_bad_, bad_values_note(statistics));
    if (!shows_data_) say_once(said_gamut_, gamut_note(frame.header, settings_).value_or(""));
    if (!options_.exposures.empty() || !options_.locked_exposure.empty()) return;
    say_once(said_held_, held_words(frame.header.target(), frame.header.target_before_limits()));
  }

  // A frame without an image of its own. If it should have begun a scene, the next frame begins it, as on the
  // server.
  absl::Status skip(size_t index, StreamFrame frame) {
    if (sequence_.frames[index].cut) summary_.state.set_cut_pending(true);
    const int64_t number = frame.number;
    absl::Status status = holds() ? held_.repeat(std::move(frame)) : images_.skip(std::move(frame));
    held_.has_none(number);
    return status.ok() ? repeat_after(index) : status;
  }

  // Whether frames without an image get that of the file before.
  bool holds() const {
    return options_.sequence.missing == MissingFrames::kHold && options_.encoding != v1::ENCODING_NONE;
  }

  absl::Status repeat_after(size_t index) {
    const SequenceFrame& file = sequence_.frames[index];
    return repeat_each(file.holds.size(), file.place + 1);
  }

  // `count` missing numbers, whose images begin at this place.
  absl::Status repeat_each(uint64_t count, uint64_t place) {
    absl::Status status;
    for (uint64_t i = 0; i < count && status.ok() && holds(); ++i) {
      StreamFrame frame = image_at(place + i);
      frame.missing = true;
      status = held_.repeat(std::move(frame));
    }
    return status;
  }

  // The image at this place in the sequence.
  StreamFrame image_at(uint64_t place) const {
    const NamedImage& image = named_[place];
    StreamFrame frame;
    frame.number = image.number;
    frame.input = image.input;
    frame.output = image.output;
    frame.media_time_ns = sequence_.media_time_ns(image.number, summary_.rate.rate);
    return frame;
  }

  StreamFrame frame_of(size_t index) const { return image_at(sequence_.frames[index].place); }

  absl::Status add_skipped(FrameFeeder& feeder, uint64_t before) {
    absl::Status status;
    for (auto& [index, why] : feeder.take_skipped(before)) {
      StreamFrame frame = frame_of(index);
      frame.status = std::move(why);
      if (status.ok()) status = skip(index, std::move(frame));
    }
    return status;
  }

  void tell_of_resume(const Session& session) {
    const SessionStats stats = session.stats();
    if (stats.resumes == resumes_) return;
    resumes_ = stats.resumes;
    progress_.clear();
    if (options_.quiet) return;
    print_note(resume_words(stats));
  }

  void show(uint64_t index) {
    const auto done = static_cast<double>(index + 1);
    const size_t frames = sequence_.frames.size();
    const auto all = static_cast<double>(frames);
    const double seconds = absl::ToDoubleSeconds(absl::Now() - begin_);
    progress_.show_bar(done / all, absl::StrFormat("%d/%d, %.1f fps, exposure %s, %.0f s left", index + 1,
                                                   frames, done / seconds, exposure_words(exposure_),
                                                   seconds / done * (all - done)));
  }

  const StreamOptions& options_;
  const ShotExposures& shot_;
  const Sequence& sequence_;
  const std::vector<NamedImage>& named_;
  Progress& progress_;
  ServerLink link_;
  StreamSummary summary_;
  StreamImages images_;
  HeldImages held_;
  absl::Time begin_;
  v1::Settings settings_;  // those of the first frame
  bool said_bad_ = false;
  bool shows_data_ = false;  // numbers, which no gamut cuts
  bool said_gamut_ = false;
  bool said_held_ = false;
  double exposure_ = 1;
  uint64_t resumes_ = 0;
};

// Prints the notes and the summary.
absl::Status tell(const StreamOptions& options, const StreamSummary& summary, const std::string& where,
                  bool json_to_stdout) {
  if (options.quiet) return absl::OkStatus();
  std::set<std::string> notes = summary.notes;
  notes.insert(options.notes.begin(), options.notes.end());
  size_t told = 0;
  for (const std::string& note : notes) {
    if (told++ < kMostNotes) print_note(note);
  }
  if (told > kMostNotes) print_note(absl::StrFormat("and %d more notes", told - kMostNotes));
  return json_to_stdout ? absl::OkStatus() : print(to_text(summary, where));
}

constexpr char kStreamExamples[] =
    "Examples:\n"
    "  candela stream 'in/*.exr' out/%04d.png --fps 24\n"
    "  candela stream in out --lookahead 4 --detect-cuts --exposure-plot exposure.svg\n"
    "  candela stream in out --server 127.0.0.1:50051,127.0.0.1:50052 --json frames.json";

Finish define_stream(CLI::App& app) {
  const auto arguments = std::make_shared<StreamArguments>();
  add_stream_options(app, *arguments);
  return [arguments](const GivenOptions& given) -> absl::StatusOr<ParsedCommand> {
    RETURN_IF_ERROR(finish_stream_options(*arguments));
    StreamOptions& options = arguments->options;
    add_idle_notes(options, {.given = given,
                             .encoding = encoding_of(options.output, options.encoding),
                             .view = !options.view.config.empty(),
                             .adapts = true,
                             .elapsed_seconds = std::numeric_limits<double>::infinity()});
    return parsed_command(options, run_stream);
  };
}

}  // namespace

absl::Status run_stream(const StreamOptions& options, JsonOutput& json) {
  ASSIGN_OR_RETURN(const ShotExposures shot, ShotExposures::open(options));
  ASSIGN_OR_RETURN(const StreamPlan plan, plan_stream(options, shot));
  const auto& [names, sequence, images] = plan;
  const bool wants_exposures = shot.saved() || !options.plot.empty();
  if (sequence.frames.empty() && wants_exposures) {
    return usage_error(
        "every image repeats a frame before --range, so there are no exposures to save or to draw; leave out "
        "--save-exposures and --exposure-plot, or give another --range");
  }
  RETURN_IF_ERROR(shot.prepare_save());
  if (!options.plot.empty()) {
    RETURN_IF_ERROR(check_plot(options.plot));
  }
  RETURN_IF_ERROR(json.open());
  if (names) {
    RETURN_IF_ERROR(make_folder_of(names->path(0, "")));
  }
  if (!options.quiet) {
    for (const std::string& note : sequence.notes) print_note(note);
  }
  Progress progress(!options.quiet);
  Imf::setGlobalThreadCount(static_cast<int>(std::thread::hardware_concurrency()));
  const absl::StatusOr<StreamSummary> summary =
      Streaming(options, shot, sequence, images, json, progress).run();
  progress.clear();
  if (!summary.ok()) return summary.status();
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
  const std::string where =
      names ? absl::StrFormat("%s .. %s", images.front().output, images.back().output) : "";
  RETURN_IF_ERROR(tell(options, *summary, where, json.to_stdout()));
  RETURN_IF_ERROR(json.add(to_json(*summary)));
  return json.close();
}

const Command kStreamCommand{"stream", "Renders a sequence of frames with exposure that adapts over time.",
                             kStreamExamples, define_stream};

}  // namespace candela
