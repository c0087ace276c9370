#include "client/cli/commands/stream/held_images.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/commands/render/render_report.h"
#include "client/cli/files/sequence/frame_files.h"
#include "client/cli/files/sequence/frame_reader.h"
#include "client/cli/options/words/option_words.h"
#include "server/base/status_macros.h"

namespace candela {

void HeldImages::begin(SessionOptions session, const ImageLimits& limits, FeedOptions feed,
                       const FrameFeeder& feeder) {
  session_ = std::move(session);
  // A frame alone has no frames after it, and another session may be open under the name.
  session_.name.clear();
  session_.lookahead = 0;
  session_.return_state = false;
  limits_ = limits;
  feed_ = std::move(feed);
  feed_.skip_bad = false;
  said_rate_ = feeder.said_rate();
}

void HeldImages::has_image(int64_t number, const std::string& path) {
  image_of_ = path;
  next_ = number + 1;
}

absl::Status HeldImages::repeat(StreamFrame frame) {
  auto file = sequence_.files.lower_bound(frame.number);
  const int64_t first = std::max(next_, sequence_.zero);
  next_ = frame.number;
  while (file != sequence_.files.begin() && std::prev(file)->first >= first) {
    --file;
    ASSIGN_OR_RETURN(Rendered rendered, render_alone(file->first, file->second));
    if (rendered.status.ok()) {
      image_of_ = file->second;
      frame.held = true;
      frame.input = image_of_;
      const std::string bad = bad_values_note(rendered.image.header.statistics());
      if (!bad.empty()) summary_.notes.insert(absl::StrCat(image_of_, ": ", bad));
      return images_.write(std::move(frame), std::move(rendered.image), rendered.facts);
    }
    if (!options_.skip_bad) return rendered.status;
    summary_.notes.insert(absl::StrFormat("not repeated: %s", rendered.status.message()));
  }
  if (image_of_.empty()) {
    frame.status.Update(failure_of(
        FailureKind::kInput, absl::NotFoundError(absl::StrFormat(
                                 "frame %d is missing, and no frame before it has an image", frame.number))));
    return images_.skip(std::move(frame));
  }
  frame.held = true;
  frame.input = image_of_;
  return images_.repeat(std::move(frame));
}

// The frame after which the session continues has the exposure of its state.
GivenExposures HeldImages::exposures_of(int64_t number) const {
  const std::optional<int64_t> after = shot_.after();
  return after == number ? GivenExposures::locked(session_.state->exposure()) : shot_.given();
}

absl::StatusOr<HeldImages::Rendered> HeldImages::render_alone(int64_t number, const std::string& path) {
  Sequence alone;
  alone.frames = {{.number = number, .path = path}};
  alone.zero = sequence_.zero;
  FrameReader reader({path}, limits_, 1, choice_of(options_, feed_.view.get()));
  FeedOptions feed = feed_;
  feed.rate = summary_.rate.rate;
  feed.exposures = exposures_of(number);
  FrameFeeder feeder(alone, std::move(feed), reader);
  Rendered rendered;
  const absl::StatusOr<const Image*> image = feeder.first();
  rendered.status = image.status();
  if (!image.ok()) return rendered;
  SessionOptions options = session_;
  options.settings = settings_for(**image, std::move(options.settings));
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
  rendered.facts = feeder.take_facts(0);
  rendered.facts.frame_rate = said_rate_;
  (void)session->next_result();  // the session's end
  return rendered;
}

}  // namespace candela
