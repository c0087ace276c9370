#include "client/cli/files/sequence/frame_feeder.h"

#include <memory>
#include <new>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/files/sequence/frame_alpha.h"
#include "client/cli/files/sequence/frame_files.h"
#include "server/base/status_macros.h"

namespace candela {

absl::StatusOr<const Image*> FrameFeeder::first() {
  while (!next_ || !next_->image.ok()) {
    next_ = reader_.next();
    if (!next_) {
      decide_rate(nullptr);
      return nullptr;
    }
    if (next_->image.ok()) break;
    RETURN_IF_ERROR(bad_file(next_->index, next_->image.status()));
  }
  RETURN_IF_ERROR(begin_with(*next_->image));
  return &*next_->image;
}

// A part of a sequence has the rate of the whole, so the files before its first frame decide.
void FrameFeeder::decide_rate(const Image* first) {
  std::string path = first == nullptr ? "" : sequence_.frames[next_->index].path;
  std::optional<FrameRate> of_file = first == nullptr ? std::nullopt : first->frame_rate;
  for (auto file = sequence_.files.begin(); !options_.rate && file != sequence_.files.end(); ++file) {
    if (file->first >= sequence_.first()) break;
    const absl::StatusOr<Image> image = reader_.read(file->second);
    if (!image.ok()) continue;
    path = file->second;
    of_file = image->frame_rate;
    break;
  }
  if (of_file && !is_usable(*of_file)) {
    const absl::MutexLock lock(&mutex_);
    notes_.insert(absl::StrFormat(
        "%s: its framesPerSecond is %d/%d, which is no usable rate, and is ignored; --fps sets the rate",
        path, of_file->frames, of_file->seconds));
    of_file.reset();
  }
  rate_ = choose_rate(options_.rate, of_file);
  if (options_.rate || of_file) said_rate_ = rate_.rate;
}

absl::Status FrameFeeder::begin_with(const Image& first) {
  decide_rate(&first);
  first_index_ = next_->index;
  first_width_ = first.width;
  first_height_ = first.height;
  return check_media_time(sequence_, rate_.rate);
}

std::vector<std::string> FrameFeeder::differences(uint64_t index, const Image& image) {
  std::vector<std::string> notes;
  const std::string& first = sequence_.frames[first_index_].path;
  const std::string& path = sequence_.frames[index].path;
  if (!size_differs_ && (image.width != first_width_ || image.height != first_height_)) {
    size_differs_ = true;
    notes.push_back(absl::StrFormat(
        "these files do not look like a sequence: %s is %dx%d, and %s %dx%d; `candela render IN... OUTDIR/` "
        "renders each for itself",
        first, first_width_, first_height_, path, image.width, image.height));
  }
  if (!rate_differs_ && !options_.rate && image.frame_rate && reduced(*image.frame_rate) != rate_.rate) {
    rate_differs_ = true;
    notes.push_back(absl::StrFormat("%s says %s fps; all frames are shown at %s; --fps changes it", path,
                                    to_text(*image.frame_rate), to_text(rate_)));
  }
  return notes;
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
  begins_scene_ |= sequence_.frames[index].cut;
  const absl::MutexLock lock(&mutex_);
  skipped_.emplace_back(index, status);
  return absl::OkStatus();
}

absl::Status FrameFeeder::feed(Session& session, v1::Settings settings) try {
  for (; next_; next_ = reader_.next()) {
    if (!next_->image.ok()) {
      RETURN_IF_ERROR(bad_file(next_->index, next_->image.status()));
      continue;
    }
    enter_scene(options_.view.get(), *next_->image);
    const absl::StatusOr<std::optional<double>> exposure =
        options_.exposures.of(sequence_.frames[next_->index].number);
    if (!exposure.ok()) {
      RETURN_IF_ERROR(bad_file(next_->index, exposure.status()));
      continue;
    }
    v1::Settings own = settings_for(*next_->image, options_.settings);
    const std::string alpha_note =
        options_.ignore_empty_alpha ? ignore_empty_alpha(*next_->image, own) : std::string();
    if (!alpha_note.empty()) next_->image->notes.push_back(alpha_note);
    next_->image->has_alpha &= keeps_alpha(own);
    if (own.alpha() != settings.alpha() || own.input_chromaticities().SerializeAsString() !=
                                               settings.input_chromaticities().SerializeAsString()) {
      settings.set_alpha(own.alpha());
      *settings.mutable_input_chromaticities() = own.input_chromaticities();
      if (!own.has_input_chromaticities()) settings.clear_input_chromaticities();
      const uint64_t from = sequence_.session_number(next_->index);
      if (!session.change_settings(from, settings).ok()) return absl::OkStatus();
    }
    // If submit() fails, the session has ended, and its results say why.
    if (!session.submit(frame(next_->index, *std::move(next_->image), *exposure)).ok())
      return absl::OkStatus();
  }
  return absl::OkStatus();
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError("out of memory while reading frames; give this process more memory");
}

SessionFrame FrameFeeder::frame(uint64_t index, Image read, std::optional<double> exposure) {
  const std::vector<std::string> differences = this->differences(index, read);
  {
    const absl::MutexLock lock(&mutex_);
    facts_[index] = {read.has_alpha, read.pixel_aspect,
                     said_rate_,     primaries_of(read, options_.settings, options_.view.get()),
                     read.kept,      read.missing_pixels};
    for (const std::string& note : read.notes) {
      // How much is missing is another number in each file.
      notes_.insert(read.missing_pixels > 0 ? absl::StrCat(sequence_.frames[index].path, ": ", note) : note);
    }
    if (read.is_cube_map) notes_.insert(cube_map_note(read));
    notes_.insert(differences.begin(), differences.end());
  }
  const auto image = std::make_shared<const Image>(std::move(read));
  return {.width = image->width,
          .height = image->height,
          .format = wire_format(image->format),
          .pixels = image->pixels.span(),
          .owner = image,
          .sequence = sequence_.session_number(index),
          .media_time_ns = sequence_.media_time_ns(sequence_.frames[index].number, rate_.rate),
          .cut = std::exchange(begins_scene_, false) || sequence_.frames[index].cut,
          .exposure = exposure,
          .timeout = options_.timeout};
}

}  // namespace candela
