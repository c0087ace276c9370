#include "client/run/sequence_run.h"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/run/frames/file_frames.h"
#include "client/run/frames/frame_reader.h"
#include "client/run/images/film_file.h"
#include "client/run/images/frame_pipe.h"
#include "client/run/images/held_frames.h"
#include "client/run/images/image_files.h"
#include "client/run/picture/frame_files.h"
#include "client/run/session_run.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kReadAhead = 2;

std::vector<std::string> inputs_of(const Sequence& sequence) {
  std::vector<std::string> inputs;
  for (const SequenceFrame& frame : sequence.frames) inputs.push_back(frame.path);
  return inputs;
}

// The frames' own settings. The table is the session's, and too large to copy for each of them.
v1::Settings without_table(v1::Settings settings) {
  settings.clear_table();
  return settings;
}

void describe(const Sequence& sequence, RunSummary& summary) {
  summary.frames = sequence.frames.size();
  summary.first = sequence.first();
  summary.last = sequence.last();
  summary.missing = to_text(sequence.missing);
}

// `stream` becomes the reader if it reads standard input.
std::unique_ptr<FrameReader> make_reader(const StreamOptions& options, StreamPlan& plan,
                                         const HeldFrameOptions& alone, PipedFrameReader*& stream) {
  PictureChoice choice = choice_of(options, alone.files.view.get());
  if (!options.from_stdin()) {
    return std::make_unique<FileFrameReader>(inputs_of(plan.sequence), alone.limits, kReadAhead,
                                             std::move(choice));
  }
  auto reader = std::make_unique<PipedFrameReader>(plan.sequence, plan.first, options.sequence.cuts,
                                                   alone.limits, std::move(choice));
  stream = reader.get();
  return reader;
}

std::unique_ptr<FrameSink> make_sink(const StreamOptions& options, const StreamPlan& plan, FilmFile* film,
                                     RunEvents& events, RunSummary& summary) {
  if (options.pipe) {
    const bool even = options.film && !options.film->full_chroma;
    return std::make_unique<FramePipe>(*options.pipe, summary.rate.rate, film, even, events, summary);
  }
  return std::make_unique<ImageFiles>(
      [&options, &plan](const FrameFacts& frame) { return output_of(options, plan, frame); }, options.write,
      events, summary);
}

absl::Status no_frame_came() {
  return input_failure(
      absl::InvalidArgumentError(absl::StrFormat(
          "%s: it ended before a frame came; look at what the program before it said", kStdinName)),
      kStdinName);
}

}  // namespace

absl::StatusOr<RunSummary> render_sequence(const StreamOptions& options, const ShotExposures& shot,
                                           StreamPlan& plan, RunEvents& events) {
  Sequence& sequence = plan.sequence;
  const bool piped = options.from_stdin();
  SessionRun run(options, events);
  RunSummary& summary = run.summary();
  RETURN_IF_ERROR(run.prepare(options.settings));
  ASSIGN_OR_RETURN(const v1::Limits limits, run.run().limits());
  HeldFrameOptions alone;
  alone.limits = image_limits(limits, options);
  alone.files = {.settings = without_table(run.session().settings),
                 .timeout = options.timeout,
                 .skip_bad = options.skip_bad,
                 .rate = shot.rate(),
                 .view = run.run().view(),
                 .ignore_empty_alpha = options.ignore_empty_alpha,
                 .desqueeze = options.desqueeze,
                 .exposures = shot.given()};
  events.begins("reading " + (piped ? kStdinName : plan.images.front().input));
  PipedFrameReader* stream = nullptr;
  const std::unique_ptr<FrameReader> reader = make_reader(options, plan, alone, stream);
  FileFrames frames(sequence, alone.files, *reader);
  if (absl::Status status = frames.open(); !status.ok()) return failure_of(FailureKind::kInput, status);
  if (piped && sequence.frames.empty()) return no_frame_came();
  summary.rate = frames.rate();
  if (shot.fixes_rate()) summary.rate.from = "exposures";
  run.session().state = shot.state();
  run.session().return_state = shot.saved();
  alone.session = run.session();
  alone.said_rate = frames.said_rate();
  std::unique_ptr<FilmFile> film;
  if (options.film) {
    const WriteOptions& write = options.write;
    ASSIGN_OR_RETURN(film, FilmFile::open(options.output, film_command(*options.film, write.transfer,
                                                                       write.hdr, FilmFile::kOutput)));
  }
  const std::unique_ptr<FrameSink> images = make_sink(options, plan, film.get(), events, summary);
  HeldFrames held(options, shot, plan, std::move(alone), run.run().link(), *images, summary);
  absl::Status status = held.begin();
  if (status.ok()) {
    status = run.render(frames, piped ? *images : held);
  } else {
    status.Update(held.finish());
  }
  if (status.ok() && stream != nullptr) status = stream->lost();
  describe(sequence, summary);
  if (!status.ok() && !summary.reader_left) return status;
  if (sequence.cut_after) summary.state.set_cut_pending(true);
  if (summary.written + summary.held == 0 && !summary.reader_left) {
    return failure_of(
        summary.skipped_for.value_or(FailureKind::kOther),
        absl::InvalidArgumentError(absl::StrFormat(
            "none of the %d frames could be rendered; run without --skip-bad to see the first failure",
            sequence.frames.size())));
  }
  if (film != nullptr) {
    events.begins("ffmpeg ends " + options.output);
    RETURN_IF_ERROR(film->finish());
  }
  summary.locked = locked_exposure(options.settings.exposure(), summary.curve);
  summary.saved = options.save_exposures;
  return std::move(summary);
}

}  // namespace candela
