#include "client/run/frames/frame_feeder.h"

#include <new>

#include "server/base/status_macros.h"

namespace candela {

bool take_input_of(const v1::Settings& own, v1::Settings& settings) {
  const auto same = [](const google::protobuf::Message& a, const google::protobuf::Message& b) {
    return a.SerializeAsString() == b.SerializeAsString();
  };
  if (own.alpha() == settings.alpha() && same(own.input_chromaticities(), settings.input_chromaticities()) &&
      same(own.output_size(), settings.output_size()) && same(own.exposure(), settings.exposure()) &&
      same(own.bloom(), settings.bloom())) {
    return false;
  }
  settings.set_alpha(own.alpha());
  settings.clear_input_chromaticities();
  if (own.has_input_chromaticities()) *settings.mutable_input_chromaticities() = own.input_chromaticities();
  settings.clear_exposure();
  if (own.has_exposure()) *settings.mutable_exposure() = own.exposure();
  settings.clear_bloom();
  if (own.has_bloom()) *settings.mutable_bloom() = own.bloom();
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

}  // namespace candela
