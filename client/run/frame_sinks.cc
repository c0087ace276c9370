#include "client/run/frame_sinks.h"

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <new>
#include <string>
#include <thread>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/write/atomic_file.h"
#include "client/image/write/encodings.h"
#include "client/run/picture_frame.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kCopiedAtOnce = 1u << 20;  // bytes

absl::StatusOr<std::vector<std::string>> write_result(const std::string& path, RenderResult result,
                                                      const FrameFacts& facts,
                                                      const WriteOptions& options) try {
  if (result.header.encoding() == v1::ENCODING_NONE) return std::vector<std::string>();
  if (result.header.encoded_bytes() > 0) {
    return write_encoded(path, result.pixels(), result.header.encoding(), facts.has_alpha,
                         facts.pixel_aspect);
  }
  const WriteOptions write = write_options_for(options, result.header, facts.kept_primaries);
  Image picture = picture_of(std::move(result), facts.has_alpha, facts.pixel_aspect);
  picture.frame_rate = facts.frame_rate;
  picture.kept = facts.kept;
  return write_image(path, picture, write);
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError(
      absl::StrFormat("%s: out of memory; give this process more memory (ulimit -v)", path));
}

absl::Status copy_file(const std::string& from, const std::string& to) {
  std::ifstream source(from, std::ios::binary);
  if (!source)
    return failure_of(
        FailureKind::kOutput,
        absl::NotFoundError(absl::StrFormat(
            "%s: cannot read it to repeat it as %s; leave the images in place until the command ends", from,
            to)));
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(to));
  std::vector<char> bytes(kCopiedAtOnce);
  while (source) {
    source.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    if (!file.write(bytes.data(), static_cast<size_t>(source.gcount()))) break;
  }
  if (source.bad()) {
    return failure_of(FailureKind::kOutput,
                      absl::UnavailableError(absl::StrFormat("%s: cannot read it to repeat it", from)));
  }
  return file.commit();
}

}  // namespace

absl::Status ImageFiles::image(RunFrame frame, RenderResult image) {
  return add(
      {frame, std::async(std::launch::async, [this, path = output_of_(frame.facts), facts = frame.facts,
                                              image = std::move(image)]() mutable {
         return write_result(path, std::move(image), facts, options_);
       })});
}

absl::Status ImageFiles::finish() {
  absl::Status status;
  while (!entries_.empty()) status.Update(finish_oldest());
  return status;
}

absl::Status ImageFiles::add(Entry entry) {
  entry.frame.output = output_of_(entry.frame.facts);
  entries_.push_back(std::move(entry));
  const size_t most = std::max<size_t>(2, std::thread::hardware_concurrency());
  absl::Status status;
  while (status.ok() && entries_.size() > most) status = finish_oldest();
  return status;
}

// Waits until the oldest image is written, and reports it.
absl::Status ImageFiles::finish_oldest() {
  Entry oldest = std::move(entries_.front());
  entries_.pop_front();
  const RunFrame& frame = oldest.frame;
  if (oldest.written.valid()) {
    ASSIGN_OR_RETURN(const std::vector<std::string> notes, oldest.written.get());
    summary_.notes.insert(notes.begin(), notes.end());
    last_ = frame.output;
  } else if (frame.held) {
    RETURN_IF_ERROR(copy_file(last_, frame.output));
    last_ = frame.output;
  }
  summary_.count(frame);
  return events_.finished(frame);
}

absl::Status FramePipe::image(RunFrame frame, RenderResult image) {
  const Image picture = picture_of(std::move(image), frame.facts.has_alpha, frame.facts.pixel_aspect);
  RETURN_IF_ERROR(begin_film(frame));
  make_piped_frame(format_, picture, bytes_);
  RETURN_IF_ERROR(write(bytes_.data(), bytes_.size()));
  return tell(std::move(frame));
}

absl::Status FramePipe::none(RunFrame frame) {
  if (frame.held) {
    RETURN_IF_ERROR(write(bytes_.data(), bytes_.size()));
  }
  return tell(std::move(frame));
}

absl::Status FramePipe::begin_film(const RunFrame& frame) {
  const uint32_t width = frame.header.width(), height = frame.header.height();
  if (width_ == 0) {
    if (even_ && (width % 2 != 0 || height % 2 != 0)) {
      return input_failure(
          absl::InvalidArgumentError(absl::StrFormat(
              "%s: it is %dx%d, and this film needs even sizes; --pipe y4m444 makes one of any size",
              frame.facts.input, width, height)),
          frame.facts.input);
    }
    width_ = width;
    height_ = height;
    if (verbose_ && format_.kind != PipeKind::kPam) {
      summary_.notes.insert(absl::StrFormat("the y4m has the matrix of %s, with limited range",
                                            matrix_of(format_, height).name));
    }
    const std::string header = film_header(format_, width, height, frame.facts.pixel_aspect, rate_);
    return write(header.data(), header.size());
  }
  if (format_.kind == PipeKind::kPam || (width == width_ && height == height_)) return absl::OkStatus();
  return input_failure(
      absl::InvalidArgumentError(absl::StrFormat(
          "%s: its image is %dx%d, and a y4m has frames of one size, here %dx%d; --resize %dx%d makes all of "
          "one size, and --pipe pam takes any",
          frame.facts.input, width, height, width_, height_, width_, height_)),
      frame.facts.input);
}

absl::Status FramePipe::write(const void* bytes, size_t count) {
  if (film_ != nullptr) return film_->write(bytes, count);
  const int error = write_to_stdout(bytes, count);
  if (error == 0) return absl::OkStatus();
  summary_.reader_left = error == EPIPE;
  return cannot_write(kStdoutName, error);
}

absl::Status FramePipe::tell(RunFrame frame) {
  if (frame.held || frame.status.ok()) frame.output = film_ != nullptr ? film_->path() : "-";
  summary_.count(frame);
  return events_.finished(frame);
}

}  // namespace candela
