#include "client/run/images/frame_pipe.h"

#include <cerrno>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/write/atomic_file.h"
#include "client/image/write/standard_output.h"
#include "client/run/picture/frame_files.h"
#include "server/base/status_macros.h"

namespace candela {

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
