#include "client/run/session_run.h"

#include <limits>
#include <new>
#include <optional>
#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/run/picture_frame.h"
#include "client/run/server_link.h"
#include "server/base/status_macros.h"

namespace candela {

bool take_input_of(const v1::Settings& own, v1::Settings& settings) {
  const auto same = [](const google::protobuf::Message& a, const google::protobuf::Message& b) {
    return a.SerializeAsString() == b.SerializeAsString();
  };
  if (own.alpha() == settings.alpha() && same(own.input_chromaticities(), settings.input_chromaticities()) &&
      same(own.output_size(), settings.output_size()) && same(own.exposure(), settings.exposure()) &&
      same(own.bloom(), settings.bloom()) && own.curve() == settings.curve() &&
      own.source_peak_nits() == settings.source_peak_nits()) {
    return false;
  }
  settings.set_alpha(own.alpha());
  settings.clear_input_chromaticities();
  if (own.has_input_chromaticities()) *settings.mutable_input_chromaticities() = own.input_chromaticities();
  settings.clear_exposure();
  if (own.has_exposure()) *settings.mutable_exposure() = own.exposure();
  settings.clear_bloom();
  if (own.has_bloom()) *settings.mutable_bloom() = own.bloom();
  settings.set_curve(own.curve());
  settings.clear_source_peak_nits();
  if (own.has_source_peak_nits()) settings.set_source_peak_nits(own.source_peak_nits());
  settings.clear_output_size();
  if (own.has_output_size()) *settings.mutable_output_size() = own.output_size();
  return true;
}

absl::StatusOr<const v1::Settings*> FrameFeeder::first() {
  while ((next_ = source_.next()) && !next_->status.ok()) {
    RETURN_IF_ERROR(skip(*std::move(next_)));
  }
  return next_ ? &next_->settings : nullptr;
}

void FrameFeeder::start(Session& session, const v1::Settings& settings) {
  thread_ = std::thread([this, &session, settings] {
    absl::Status status = feed(session, settings);
    {
      const absl::MutexLock lock(&mutex_);
      status_ = std::move(status);
    }
    session.finish();
  });
}

void FrameFeeder::join() {
  if (thread_.joinable()) thread_.join();
}

absl::Status FrameFeeder::status() const {
  const absl::MutexLock lock(&mutex_);
  return status_;
}

FrameFacts FrameFeeder::take_facts(uint64_t sequence) {
  const absl::MutexLock lock(&mutex_);
  const auto node = facts_.extract(sequence);
  return node ? std::move(node.mapped()) : FrameFacts();
}

std::vector<std::pair<FrameFacts, absl::Status>> FrameFeeder::take_skipped(uint64_t sequence) {
  const absl::MutexLock lock(&mutex_);
  std::vector<std::pair<FrameFacts, absl::Status>> skipped;
  while (!skipped_.empty() && skipped_.front().frame.sequence < sequence) {
    skipped.emplace_back(std::move(skipped_.front().facts), std::move(skipped_.front().status));
    skipped_.pop_front();
  }
  return skipped;
}

std::set<std::string> FrameFeeder::take_notes() {
  const absl::MutexLock lock(&mutex_);
  return std::exchange(notes_, {});
}

absl::Status FrameFeeder::skip(SourceFrame frame) {
  if (!skip_bad_) return frame.status;
  const absl::MutexLock lock(&mutex_);
  skipped_.push_back(std::move(frame));
  return absl::OkStatus();
}

absl::Status FrameFeeder::feed(Session& session, v1::Settings settings) try {
  for (; next_; next_ = source_.next()) {
    if (!next_->status.ok()) {
      RETURN_IF_ERROR(skip(*std::move(next_)));
      continue;
    }
    // If a call fails, the session has ended, and its results say why.
    if (take_input_of(next_->settings, settings) &&
        !session.change_settings(next_->frame.sequence, settings).ok()) {
      return absl::OkStatus();
    }
    {
      const absl::MutexLock lock(&mutex_);
      facts_[next_->frame.sequence] = std::move(next_->facts);
      notes_.insert(next_->notes.begin(), next_->notes.end());
    }
    if (!session.submit(std::move(next_->frame)).ok()) return absl::OkStatus();
  }
  return absl::OkStatus();
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError("out of memory while reading frames; give this process more memory");
}

namespace {

constexpr uint64_t kAll = std::numeric_limits<uint64_t>::max();
constexpr char kMixedBits[] =
    "the session's servers do not render the same bits, so its images are not those of one server; "
    "compare \"bits\" of candela info";

}  // namespace

SessionRun::SessionRun(const SessionRunOptions& options, RunEvents& events)
    : options_(options), events_(events), run_(options, events) {}

absl::Status SessionRun::prepare(v1::Settings settings) {
  RETURN_IF_ERROR(run_.bake());
  if (const auto& view = run_.view()) {
    show_by(*view, settings);
    summary_.notes.insert(view->notes.begin(), view->notes.end());
    summary_.view = view_words(view->report);
  }
  session_.settings = std::move(settings);
  session_.name = options_.session;
  session_.lookahead = options_.lookahead;
  session_.cut_threshold_ev = options_.cut_threshold_ev;
  session_.encoding = options_.encoding;
  session_.jpeg_quality = static_cast<uint32_t>(options_.write.jpeg_quality);
  return options_.settings.tier().empty() ? absl::OkStatus() : run_.connect();
}

absl::Status SessionRun::render(FrameSource& source, FrameSink& sink) {
  progress_.frames = source.frames();
  FrameFeeder feeder(source, options_.skip_bad);
  const absl::StatusOr<const v1::Settings*> first = feeder.first();
  if (!first.ok()) return failure_of(FailureKind::kInput, first.status());
  absl::Status status = take_skipped(feeder, kAll, sink);
  if (status.ok() && *first != nullptr) {
    take_input_of(**first, session_.settings);
    status = exchange(feeder, sink);
    if (status.ok()) status = take_skipped(feeder, kAll, sink);
  }
  status.Update(sink.finish());
  status.Update(feeder.status());
  return status;
}

absl::Status SessionRun::exchange(FrameFeeder& feeder, FrameSink& sink) {
  events_.begins("opening a session");
  absl::StatusOr<Session> session = run_.link().open_session(session_);
  if (!session.ok()) return in_options(session.status(), options_.settings);
  begin_ = absl::Now();
  feeder.start(*session, session_.settings);
  // The feeder uses the session until its end, which may also come by an exception.
  const absl::Cleanup stop_feeding = [&] {
    session->cancel();
    feeder.stop();
    feeder.join();
  };
  absl::Status status = take_results(*session, feeder, sink);
  if (!status.ok()) {
    session->cancel();
    feeder.stop();
  }
  // The feeder ends after the last frame, or when submit() fails.
  feeder.join();
  if (status.ok()) status = sink.finish();
  summary_.time = absl::Now() - begin_;
  summary_.session = session->stats();
  if (summary_.session.mixed_bits && session_.encoding != v1::ENCODING_NONE)
    summary_.notes.insert(kMixedBits);
  summary_.notes.merge(feeder.take_notes());
  return status;
}

absl::Status SessionRun::take_results(Session& session, FrameFeeder& feeder, FrameSink& sink) {
  while (true) {
    absl::StatusOr<std::optional<FrameResult>> result = session.next_result();
    if (!result.ok()) return in_options(result.status(), options_.settings);
    if (!*result) return absl::OkStatus();
    tell_of_resume(session);
    const uint64_t sequence = (*result)->sequence;
    RETURN_IF_ERROR(take_skipped(feeder, sequence, sink));
    RETURN_IF_ERROR(take(**result, feeder.take_facts(sequence), sink));
    progress_.time = absl::Now() - begin_;
    events_.progress(progress_);
  }
}

absl::Status SessionRun::take(FrameResult& result, FrameFacts facts, FrameSink& sink) {
  RunFrame frame;
  frame.facts = std::move(facts);
  if (!result.status.ok()) {
    frame.status = name_file(in_options(result.status, options_.settings), frame.facts.input);
    return without_image(std::move(frame), sink);
  }
  frame.header = result.image.header;
  frame.latency = result.latency;
  ++progress_.done;
  progress_.exposure = frame.header.exposure();
  add_notes_on(frame);
  summary_.primaries.insert(words_of(frame.facts.primaries));
  summary_.defaults = frame.facts.defaults;
  summary_.curve.push_back({.frame = frame.facts.number,
                            .media_time_ns = frame.facts.media_time_ns,
                            .exposure = frame.header.exposure(),
                            .target = frame.header.target(),
                            .mean_log2_luminance = frame.header.statistics().mean_log2_luminance(),
                            .cut = frame.header.cut()});
  summary_.state = frame.header.state();
  return sink.image(std::move(frame), std::move(result.image));
}

absl::Status SessionRun::take_skipped(FrameFeeder& feeder, uint64_t before, FrameSink& sink) {
  for (auto& [facts, why] : feeder.take_skipped(before)) {
    RunFrame frame;
    frame.facts = std::move(facts);
    frame.status = std::move(why);
    RETURN_IF_ERROR(without_image(std::move(frame), sink));
  }
  return absl::OkStatus();
}

// If the frame should have begun a scene, the next one begins it, as on the server.
absl::Status SessionRun::without_image(RunFrame frame, FrameSink& sink) {
  if (!options_.skip_bad) return frame.status;
  ++progress_.done;
  if (frame.facts.cut) summary_.state.set_cut_pending(true);
  return sink.none(std::move(frame));
}

// Once a session, because the numbers are others for each frame.
void SessionRun::add_notes_on(const RunFrame& frame) {
  const auto say_once = [&](bool& said, const std::string& words) {
    if (!words.empty() && !std::exchange(said, true)) {
      summary_.notes.insert(frame.facts.input + ": " + words);
    }
  };
  const v1::ResultHeader& header = frame.header;
  say_once(said_bad_, bad_values_note(header.statistics()));
  if (run_.shows_light())
    say_once(said_gamut_,
             gamut_note(header, session_.settings, frame.facts.defaults.light, options_.names_primaries)
                 .value_or(""));
  if (frame.facts.exposure_given) return;
  say_once(said_held_, held_words(header.target(), header.target_before_limits()));
}

void SessionRun::tell_of_resume(const Session& session) {
  const SessionStats stats = session.stats();
  if (stats.resumes == summary_.session.resumes) return;
  summary_.session.resumes = stats.resumes;
  events_.resumed(stats);
}

}  // namespace candela
