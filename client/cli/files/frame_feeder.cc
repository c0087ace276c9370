#include "client/cli/files/frame_feeder.h"

#include <cmath>
#include <memory>
#include <new>

#include "client/cli/files/frame_files.h"

namespace candela {

int64_t media_time_ns(uint64_t index, double fps) {
  return std::llround(static_cast<double>(index) * 1e9 / fps);
}

absl::StatusOr<const Image*> FrameFeeder::first() {
  while (!next_ || !next_->image.ok()) {
    next_ = reader_.next();
    if (!next_) return nullptr;
    if (next_->image.ok()) break;
    if (absl::Status status = bad_file(next_->index, next_->image.status()); !status.ok()) return status;
  }
  return &*next_->image;
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

FrameFacts FrameFeeder::take_facts(uint64_t index) {
  const absl::MutexLock lock(&mutex_);
  const auto node = facts_.extract(index);
  return node ? node.mapped() : FrameFacts();
}

std::vector<std::pair<uint64_t, absl::Status>> FrameFeeder::take_skipped(uint64_t index) {
  const absl::MutexLock lock(&mutex_);
  std::vector<std::pair<uint64_t, absl::Status>> skipped;
  while (!skipped_.empty() && skipped_.front().first < index) {
    skipped.push_back(std::move(skipped_.front()));
    skipped_.pop_front();
  }
  return skipped;
}

std::set<std::string> FrameFeeder::take_notes() {
  const absl::MutexLock lock(&mutex_);
  return std::exchange(notes_, {});
}

absl::Status FrameFeeder::bad_file(uint64_t index, const absl::Status& status) {
  if (!options_.skip_bad) return status;
  const absl::MutexLock lock(&mutex_);
  skipped_.emplace_back(index, status);
  return absl::OkStatus();
}

absl::Status FrameFeeder::feed(Session& session, v1::Settings settings) try {
  for (; next_; next_ = reader_.next()) {
    if (!next_->image.ok()) {
      if (absl::Status status = bad_file(next_->index, next_->image.status()); !status.ok()) return status;
      continue;
    }
    v1::Settings own = settings_for(*next_->image, options_.settings);
    if (own.input_chromaticities().SerializeAsString() !=
        settings.input_chromaticities().SerializeAsString()) {
      *settings.mutable_input_chromaticities() = own.input_chromaticities();
      if (!own.has_input_chromaticities()) settings.clear_input_chromaticities();
      if (!session.change_settings(next_->index, settings).ok()) return absl::OkStatus();
    }
    // If submit() fails, the session has ended, and its results say why.
    if (!session.submit(frame(next_->index, *std::move(next_->image))).ok()) return absl::OkStatus();
  }
  return absl::OkStatus();
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError("out of memory while reading frames; give this process more memory");
}

SessionFrame FrameFeeder::frame(uint64_t index, Image read) {
  {
    const absl::MutexLock lock(&mutex_);
    facts_[index] = {read.has_alpha, read.pixel_aspect};
    notes_.insert(read.notes.begin(), read.notes.end());
  }
  const auto image = std::make_shared<const Image>(std::move(read));
  return {.width = image->width,
          .height = image->height,
          .format = wire_format(image->format),
          .pixels = image->pixels.span(),
          .owner = image,
          .sequence = index,
          .media_time_ns = media_time_ns(index, options_.fps),
          .timeout = options_.timeout};
}

}  // namespace candela
