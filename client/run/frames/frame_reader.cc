#include "client/run/frames/frame_reader.h"

#include <unistd.h>

#include <algorithm>
#include <new>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"

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

}  // namespace candela
