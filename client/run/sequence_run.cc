#include "client/run/sequence_run.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/run/frames/file_frames.h"
#include "client/run/frames/frame_reader.h"
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

std::vector<std::string> outputs_of(const StreamPlan& plan) {
  std::vector<std::string> outputs;
  for (const NamedImage& image : plan.images) outputs.push_back(image.output);
  return outputs;
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

}  // namespace

absl::StatusOr<RunSummary> render_sequence(const StreamOptions& options, const ShotExposures& shot,
                                           const StreamPlan& plan, RunEvents& events) {
  const Sequence& sequence = plan.sequence;
  SessionRun run(options, events);
  RunSummary& summary = run.summary();
  describe(sequence, summary);
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
                 .exposures = shot.given()};
  events.begins("reading " + plan.images.front().input);
  FrameReader reader(inputs_of(sequence), alone.limits, kReadAhead,
                     choice_of(options, alone.files.view.get()));
  FileFrames frames(sequence, alone.files, reader);
  if (absl::Status status = frames.open(); !status.ok()) return failure_of(FailureKind::kInput, status);
  summary.rate = frames.rate();
  if (shot.fixes_rate()) summary.rate.from = "exposures";
  run.session().state = shot.state();
  run.session().return_state = shot.saved();
  alone.session = run.session();
  alone.said_rate = frames.said_rate();
  ImageFiles images(outputs_of(plan), options.write, events, summary);
  HeldFrames held(options, shot, plan, std::move(alone), run.run().link(), images, summary);
  absl::Status status = held.begin();
  if (!status.ok()) {
    status.Update(held.finish());
    return status;
  }
  RETURN_IF_ERROR(run.render(frames, held));
  if (sequence.cut_after) summary.state.set_cut_pending(true);
  if (summary.written + summary.held == 0) {
    return failure_of(
        summary.skipped_for.value_or(FailureKind::kOther),
        absl::InvalidArgumentError(absl::StrFormat(
            "none of the %d frames could be rendered; run without --skip-bad to see the first failure",
            sequence.frames.size())));
  }
  summary.locked = locked_exposure(options.settings.exposure(), summary.curve);
  summary.saved = options.save_exposures;
  return std::move(summary);
}

}  // namespace candela
