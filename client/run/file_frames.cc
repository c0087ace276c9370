#include "client/run/file_frames.h"

#include <unistd.h>

#include <algorithm>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/run/picture_frame.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

absl::Status out_of_memory(const std::string& name) {
  return failure_of(FailureKind::kOther,
                    absl::ResourceExhaustedError(absl::StrFormat(
                        "%s: out of memory; give this process more memory (ulimit -v)", name)));
}

}  // namespace

FileFrameReader::FileFrameReader(std::vector<std::string> paths, const ImageLimits& limits, size_t ahead,
                                 PictureChoice choice)
    : paths_(std::move(paths)), limits_(limits), choice_(std::move(choice)), ahead_(ahead) {
  read_ahead();
}

void FileFrameReader::read_ahead() {
  for (; at_ < paths_.size() && reading_.size() < ahead_; ++at_) {
    reading_.push_back(std::async(std::launch::async, [&path = paths_[at_], this]() -> absl::StatusOr<Image> {
      try {
        return read_image(path, limits_, choice_);
      } catch (const std::bad_alloc&) {
        return out_of_memory(path);
      }
    }));
  }
}

std::optional<FrameReader::Read> FileFrameReader::next() {
  if (reading_.empty()) return std::nullopt;
  const size_t index = at_ - reading_.size();
  absl::StatusOr<Image> image = reading_.front().get();
  reading_.pop_front();
  read_ahead();
  return Read{index, std::move(image)};
}

PipedFrameReader::PipedFrameReader(Sequence& sequence, int64_t first, std::vector<int64_t> cuts,
                                   const ImageLimits& limits, PictureChoice choice)
    : sequence_(sequence),
      number_(first),
      cuts_(std::move(cuts)),
      stream_(STDIN_FILENO, kStdinName, limits, std::move(choice)) {}

std::optional<FrameReader::Read> PipedFrameReader::next() {
  std::optional<absl::StatusOr<Image>> image;
  try {
    image = stream_.next();
  } catch (const std::bad_alloc&) {
    image = out_of_memory(stream_.name());
  }
  if (!image) return std::nullopt;
  const size_t index = sequence_.frames.size();
  sequence_.frames.push_back({.number = number_,
                              .path = stream_.name(),
                              .cut = std::ranges::binary_search(cuts_, number_),
                              .place = index});
  ++number_;
  return Read{index, *std::move(image)};
}

absl::StatusOr<Image> PipedFrameReader::read(const std::string& path) const {
  return absl::UnimplementedError(absl::StrFormat("%s: it is no frame of the pipe", path));
}

absl::Status FileFrames::open() {
  while (std::optional<FrameReader::Read> read = reader_.next()) {
    read_.push_back(*std::move(read));
    const absl::StatusOr<Image>& image = read_.back().image;
    if (!image.ok()) {
      if (!options_.skip_bad) return image.status();
      continue;
    }
    decide_rate(&read_.back());
    first_path_ = sequence_.frames[read_.back().index].path;
    first_width_ = image->width;
    first_height_ = image->height;
    return check_media_time(sequence_, rate_.rate);
  }
  decide_rate(nullptr);
  return absl::OkStatus();
}

// A part of a sequence has the rate of the whole, so the files before its first frame decide.
void FileFrames::decide_rate(const FrameReader::Read* first) {
  std::string path = first == nullptr ? "" : sequence_.frames[first->index].path;
  std::optional<FrameRate> of_file = first == nullptr ? std::nullopt : first->image->frame_rate;
  for (auto file = sequence_.files.begin(); !options_.rate && file != sequence_.files.end(); ++file) {
    if (file->first >= sequence_.first()) break;
    const absl::StatusOr<Image> image = reader_.read(file->second);
    if (!image.ok()) continue;
    path = file->second;
    of_file = image->frame_rate;
    break;
  }
  if (of_file && !is_usable(*of_file)) {
    rate_notes_.push_back(
        absl::StrFormat("%s: its frame rate %d/%d cannot be used, so it is ignored; --fps sets the rate",
                        path, of_file->frames, of_file->seconds));
    of_file.reset();
  }
  rate_ = choose_rate(options_.rate, of_file);
  if (options_.rate || of_file) said_rate_ = rate_.rate;
}

std::optional<SourceFrame> FileFrames::next() {
  std::optional<FrameReader::Read> read;
  if (read_.empty()) {
    read = reader_.next();
  } else {
    read = std::move(read_.front());
    read_.pop_front();
  }
  if (!read) return std::nullopt;
  const SequenceFrame& file = sequence_.frames[read->index];
  SourceFrame made;
  made.frame.sequence = sequence_.session_number(read->index);
  made.facts.number = file.number;
  made.facts.input = file.path;
  made.facts.place = file.place;
  made.facts.media_time_ns = sequence_.media_time_ns(file.number, rate_.rate);
  made.facts.cut = file.cut;
  made.status = make(std::move(read->image), file, made);
  if (!made.status.ok()) begins_scene_ |= file.cut;
  return made;
}

absl::Status FileFrames::make(absl::StatusOr<Image> read, const SequenceFrame& file, SourceFrame& made) {
  RETURN_IF_ERROR(read.status());
  Image& frame = *read;
  enter_scene(options_.view.get(), frame);
  ASSIGN_OR_RETURN(const std::optional<double> exposure, options_.exposures.of(file.number));
  if (options_.scene_light) frame.light = PictureLight::kScene;
  RETURN_IF_ERROR(
      check_light_for_gain_map(file.path, frame.light, options_.settings.has_gain_map_peak_nits()));
  PictureSettings shown = settings_for(
      frame, options_.settings,
      {.exposure = exposure, .defaults = options_.defaults, .names_primaries = options_.names_primaries});
  made.settings = std::move(shown.settings);
  made.facts.defaults = shown.defaults;
  made.facts.kept_primaries = shown.kept_primaries;
  if (std::string note = not_metered_note(frame, options_.settings, shown.defaults); !note.empty())
    frame.notes.push_back(std::move(note));
  if (options_.ignore_empty_alpha) {
    const std::string note = ignore_empty_alpha(frame, made.settings);
    if (!note.empty()) frame.notes.push_back(note);
  }
  made.facts.size = {frame.width, frame.height};
  if (options_.desqueeze) frame.notes.push_back(desqueeze(frame, made.settings));
  const v1::OutputSize& asked = made.settings.output_size();
  if (std::string note = shape_note(made.facts.size, asked); !note.empty()) frame.notes.push_back(note);
  add_notes(frame, file.path, made.notes);
  made.facts.has_alpha = frame.has_alpha && keeps_alpha(made.settings);
  made.facts.pixel_aspect = image_pixel_aspect(made.facts.size, frame.pixel_aspect, asked);
  made.facts.frame_rate = said_rate_;
  made.facts.primaries = primaries_of(frame, options_.settings, options_.view.get());
  made.facts.exposure_given = exposure.has_value();
  made.facts.kept = frame.kept;
  made.facts.missing_pixels = frame.missing_pixels;
  const auto image = std::make_shared<const Image>(std::move(frame));
  made.frame = {.width = image->width,
                .height = image->height,
                .format = wire_format(image->format),
                .pixels = image->pixels.span(),
                .owner = image,
                .sequence = made.frame.sequence,
                .media_time_ns = made.facts.media_time_ns,
                .cut = std::exchange(begins_scene_, false) || file.cut,
                .exposure = exposure,
                .timeout = options_.timeout};
  return absl::OkStatus();
}

// Also, once each, that files have another size or another rate than the first.
void FileFrames::add_notes(const Image& image, const std::string& path, std::vector<std::string>& notes) {
  notes = std::exchange(rate_notes_, {});
  for (const std::string& note : image.notes) {
    // How much is missing is another number in each file.
    notes.push_back(image.missing_pixels > 0 ? absl::StrCat(path, ": ", note) : note);
  }
  if (image.is_cube_map) notes.push_back(cube_map_note(image));
  if (!size_differs_ && (image.width != first_width_ || image.height != first_height_)) {
    size_differs_ = true;
    notes.push_back(absl::StrFormat(
        "these files do not look like a sequence: %s is %dx%d, and %s %dx%d; `candela render IN... OUTDIR/` "
        "renders each for itself",
        first_path_, first_width_, first_height_, path, image.width, image.height));
  }
  if (!rate_differs_ && !options_.rate && image.frame_rate && reduced(*image.frame_rate) != rate_.rate) {
    rate_differs_ = true;
    notes.push_back(absl::StrFormat("%s says %s fps; all frames are shown at %s; --fps changes it", path,
                                    to_text(*image.frame_rate), to_text(rate_)));
  }
}

}  // namespace candela
