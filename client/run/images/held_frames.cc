#include "client/run/images/held_frames.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/run/frames/frame_feeder.h"
#include "client/run/frames/frame_reader.h"
#include "client/run/picture/frame_files.h"
#include "client/run/picture/frame_notes.h"
#include "client/run/server/option_words.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

HeldFrames::HeldFrames(const StreamOptions& options, const ShotExposures& shot, const StreamPlan& plan,
                       HeldFrameOptions alone, ServerLink& link, FrameSink& images, RunSummary& summary)
    : options_(options),
      shot_(shot),
      sequence_(plan.sequence),
      named_(plan.images),
      alone_(std::move(alone)),
      link_(link),
      images_(images),
      summary_(summary) {
  // A frame alone has no frames after it, and another session may be open under the name.
  alone_.session.name.clear();
  alone_.session.lookahead = 0;
  alone_.session.return_state = false;
  alone_.files.skip_bad = false;
}

absl::Status HeldFrames::image(RunFrame frame, RenderResult image) {
  image_of_ = frame.facts.input;
  next_ = frame.facts.number + 1;
  const int64_t number = frame.facts.number;
  RETURN_IF_ERROR(images_.image(std::move(frame), std::move(image)));
  return repeat_after(number);
}

absl::Status HeldFrames::none(RunFrame frame) {
  const int64_t number = frame.facts.number;
  RETURN_IF_ERROR(holds() ? repeat(std::move(frame)) : images_.none(std::move(frame)));
  next_ = number + 1;
  return repeat_after(number);
}

bool HeldFrames::holds() const {
  return options_.sequence.missing == MissingFrames::kHold && options_.encoding != v1::ENCODING_NONE;
}

absl::Status HeldFrames::repeat_after(int64_t number) {
  const size_t index = sequence_.index_of(static_cast<uint64_t>(number - sequence_.zero));
  CHECK(index < sequence_.frames.size() && sequence_.frames[index].number == number);
  const SequenceFrame& file = sequence_.frames[index];
  return repeat_each(file.holds.size(), file.place + 1);
}

absl::Status HeldFrames::repeat_each(uint64_t count, uint64_t place) {
  absl::Status status;
  for (const uint64_t end = place + count; place < end && status.ok() && holds(); ++place) {
    RunFrame frame;
    frame.facts.number = named_[place].number;
    frame.facts.input = named_[place].input;
    frame.facts.place = place;
    frame.facts.media_time_ns = sequence_.media_time_ns(frame.facts.number, summary_.rate.rate);
    frame.missing = true;
    status = repeat(std::move(frame));
  }
  return status;
}

absl::Status HeldFrames::repeat(RunFrame frame) {
  FrameFacts& facts = frame.facts;
  auto file = sequence_.files.lower_bound(facts.number);
  const int64_t first = std::max(next_, sequence_.zero);
  next_ = facts.number;
  while (file != sequence_.files.begin() && std::prev(file)->first >= first) {
    --file;
    ASSIGN_OR_RETURN(Rendered rendered, render_alone(file->first, file->second));
    if (rendered.status.ok()) {
      image_of_ = file->second;
      frame.held = true;
      rendered.facts.number = facts.number;
      rendered.facts.place = facts.place;
      rendered.facts.media_time_ns = facts.media_time_ns;
      facts = std::move(rendered.facts);
      const std::string bad = bad_values_note(rendered.image.header.statistics());
      if (!bad.empty()) summary_.notes.insert(absl::StrCat(image_of_, ": ", bad));
      return images_.image(std::move(frame), std::move(rendered.image));
    }
    if (!options_.skip_bad) return rendered.status;
    summary_.notes.insert(absl::StrFormat("not repeated: %s", rendered.status.message()));
  }
  if (image_of_.empty()) {
    frame.status.Update(failure_of(
        FailureKind::kInput, absl::NotFoundError(absl::StrFormat(
                                 "frame %d is missing, and no frame before it has an image", facts.number))));
    return images_.none(std::move(frame));
  }
  frame.held = true;
  facts.input = image_of_;
  return images_.none(std::move(frame));
}

// The frame after which the session continues has the exposure of its state.
GivenExposures HeldFrames::exposures_of(int64_t number) const {
  const std::optional<int64_t> after = shot_.after();
  return after == number ? GivenExposures::locked(alone_.session.state->exposure()) : shot_.given();
}

absl::StatusOr<HeldFrames::Rendered> HeldFrames::render_alone(int64_t number, const std::string& path) {
  Sequence alone;
  alone.frames = {{.number = number, .path = path}};
  alone.zero = sequence_.zero;
  FileFrameReader reader({path}, alone_.limits, 1, choice_of(options_, alone_.files.view.get()));
  FileFrameOptions files = alone_.files;
  files.rate = summary_.rate.rate;
  files.exposures = exposures_of(number);
  FileFrames frames(alone, std::move(files), reader);
  FrameFeeder feeder(frames, /*skip_bad=*/false);
  Rendered rendered;
  rendered.status = frames.open();
  if (!rendered.status.ok()) return rendered;
  const absl::StatusOr<const v1::Settings*> first = feeder.first();
  rendered.status = first.status();
  if (!first.ok()) return rendered;
  SessionOptions options = alone_.session;
  take_input_of(**first, options.settings);
  // A session continues only with later frames.
  if (const std::optional<int64_t> after = shot_.after(); after >= number) options.state.reset();
  absl::StatusOr<Session> session = link_.open_session(options);
  if (!session.ok()) return in_options(session.status(), options_.settings);
  feeder.start(*session, options.settings);
  // The feeder uses the session until its end, which may also come by an exception.
  const absl::Cleanup stop_feeding = [&] {
    session->cancel();
    feeder.join();
  };
  absl::StatusOr<std::optional<FrameResult>> result = session->next_result();
  if (!result.ok()) return in_options(result.status(), options_.settings);
  summary_.notes.merge(feeder.take_notes());
  if (!*result) {
    feeder.join();
    rendered.status = feeder.status();
    return rendered;
  }
  rendered.status = name_file(in_options((*result)->status, options_.settings), path);
  rendered.image = std::move((*result)->image);
  rendered.facts = feeder.take_facts((*result)->sequence);
  rendered.facts.frame_rate = alone_.said_rate;
  (void)session->next_result();  // the session's end
  return rendered;
}

}  // namespace candela
