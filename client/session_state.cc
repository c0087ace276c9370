#include "client/session_state.h"

#include <algorithm>
#include <utility>

#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

SessionState::SessionState(const SessionOptions& options, std::string server, Clock& clock,
                           std::function<void()> wake)
    : lookahead_(options.lookahead),
      clock_(clock),
      wake_(std::move(wake)),
      log_(options.settings, options.state,
           options.encoding == v1::ENCODING_RAW || options.encoding == v1::ENCODING_UNSPECIFIED) {
  stats_.server = std::move(server);
}

absl::Status SessionState::wait_until_open() const {
  const absl::MutexLock lock(&mutex_);
  const auto decided = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return was_open_ || ended_; };
  mutex_.Await(absl::Condition(&decided));
  return was_open_ ? absl::OkStatus() : end_;
}

absl::Status SessionState::submit(SessionFrame frame) {
  const absl::MutexLock lock(&mutex_);
  const auto may = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return may_submit(); };
  mutex_.Await(absl::Condition(&may));
  RETURN_IF_ERROR(still_taking());
  RETURN_IF_ERROR(log_.add(std::move(frame), clock_.now()));
  ++submitted_;
  wake_();
  return absl::OkStatus();
}

bool SessionState::ready() const {
  const absl::MutexLock lock(&mutex_);
  return may_submit();
}

absl::Status SessionState::change_settings(uint64_t from_sequence, const v1::Settings& settings) {
  const absl::MutexLock lock(&mutex_);
  RETURN_IF_ERROR(still_taking());
  RETURN_IF_ERROR(log_.change(from_sequence, settings));
  wake_();
  return absl::OkStatus();
}

void SessionState::finish() {
  const absl::MutexLock lock(&mutex_);
  finished_ = true;
  wake_();
}

void SessionState::cancel() {
  const absl::MutexLock lock(&mutex_);
  cancelled_ = true;
  wake_();
}

absl::StatusOr<std::optional<FrameResult>> SessionState::next_result() {
  const absl::MutexLock lock(&mutex_);
  const auto any = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return !results_.empty() || ended_; };
  mutex_.Await(absl::Condition(&any));
  if (results_.empty()) {
    if (!end_.ok()) return end_;
    return std::nullopt;
  }
  std::optional<FrameResult> result = std::move(results_.front());
  results_.pop_front();
  return result;
}

bool SessionState::result_ready() const {
  const absl::MutexLock lock(&mutex_);
  return !results_.empty() || ended_;
}

SessionStats SessionState::stats() const {
  const absl::MutexLock lock(&mutex_);
  SessionStats stats = stats_;
  stats.window = window_;
  stats.submitted = submitted_;
  stats.answered = submitted_ - log_.unanswered();
  if (lost_) stats.time_without_results += clock_.now() - *lost_;
  return stats;
}

uint64_t SessionState::image_bytes(v1::ImageSize frame) const {
  const absl::MutexLock lock(&mutex_);
  return log_.image_bytes(frame);
}

SessionState::Need SessionState::need(bool idle) {
  const absl::MutexLock lock(&mutex_);
  if (!needs_server()) return Need::kNotYet;
  if (idle && lost_) lost_ = clock_.now();  // until now no result was due
  return !was_open_ || !finished_ || log_.unanswered() > 0 ? Need::kCall : Need::kOver;
}

std::optional<SessionState::Start> SessionState::begin_call(const std::string& server) {
  const absl::MutexLock lock(&mutex_);
  stats_.server = server;
  if (cancelled_) return std::nullopt;
  sent_before_ = log_.rewind();
  return Start{log_.token(), log_.settings()};
}

SessionState::NextStep SessionState::next_step() {
  const absl::MutexLock lock(&mutex_);
  const SessionStep* step = log_.next();
  if (step == nullptr) return {.finished = finished_};
  return {.step = *step};
}

DueFrame SessionState::due_frame() const {
  const absl::MutexLock lock(&mutex_);
  const SessionStep* step = log_.due();
  return step == nullptr ? DueFrame() : DueFrame{step->frame, step->image};
}

bool SessionState::take_open(const v1::StreamOpened& opened) {
  const absl::MutexLock lock(&mutex_);
  window_ = std::max<uint32_t>(1, opened.max_frames_in_flight()) + lookahead_;
  if (was_open_) {
    ++stats_.resumes;
    stats_.sent_again += sent_before_;
  }
  was_open_ = true;
  if (!opened.bits().empty()) {
    stats_.mixed_bits |= !bits_.empty() && bits_ != opened.bits();
    bits_ = opened.bits();
  }
  if (log_.unanswered() > 0) return false;
  found_again();
  return true;
}

void SessionState::take_answer(FrameAnswer answer) {
  const absl::MutexLock lock(&mutex_);
  CHECK(log_.due() != nullptr && !ended_);
  const SessionStep& step = *log_.due();
  results_.push_back({step.frame->sequence, std::move(answer.status), std::move(answer.image),
                      clock_.now() - step.submitted});
  log_.answered(answer.token);
  CHECK(log_.unanswered() < submitted_);
  found_again();
}

std::map<std::string, std::shared_ptr<const Panorama>> SessionState::panoramas() const {
  const absl::MutexLock lock(&mutex_);
  return log_.panoramas();
}

bool SessionState::cancelled() const {
  const absl::MutexLock lock(&mutex_);
  return cancelled_;
}

bool SessionState::was_open() const {
  const absl::MutexLock lock(&mutex_);
  return was_open_;
}

bool SessionState::complete() const {
  const absl::MutexLock lock(&mutex_);
  return finished_ && log_.unanswered() == 0;
}

absl::Time SessionState::lose(const absl::Status& status) {
  const absl::MutexLock lock(&mutex_);
  stats_.last_loss = status;
  if (!lost_) lost_ = clock_.now();
  return *lost_;
}

void SessionState::end(const absl::Status& status) {
  const absl::MutexLock lock(&mutex_);
  CHECK(!ended_);
  ended_ = true;
  end_ = cancelled_ ? absl::CancelledError("the session was cancelled") : status;
  found_again();
}

// Frames that look-ahead holds back are not due.
bool SessionState::needs_server() const {
  return cancelled_ || !was_open_ || finished_ || log_.unanswered() > lookahead_;
}

bool SessionState::may_submit() const {
  return ended_ || finished_ || (log_.unanswered() < window_ && results_.size() < window_);
}

absl::Status SessionState::still_taking() const {
  if (ended_ && !end_.ok()) return end_;
  if (!finished_) return absl::OkStatus();
  return absl::FailedPreconditionError(
      "finish() was called on this session; open another one for more frames");
}

void SessionState::found_again() {
  if (!lost_) return;
  stats_.time_without_results += clock_.now() - *lost_;
  lost_.reset();
}

}  // namespace candela
