#include "client/run/frames/frame_reader.h"

#include <new>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"

namespace candela {

FrameReader::FrameReader(std::vector<std::string> paths, const ImageLimits& limits, size_t ahead,
                         PictureChoice choice)
    : paths_(std::move(paths)), limits_(limits), choice_(std::move(choice)), ahead_(ahead) {
  read_ahead();
}

void FrameReader::read_ahead() {
  for (; at_ < paths_.size() && reading_.size() < ahead_; ++at_) {
    reading_.push_back(std::async(std::launch::async, [&path = paths_[at_], this]() -> absl::StatusOr<Image> {
      try {
        return read_image(path, limits_, choice_);
      } catch (const std::bad_alloc&) {
        return failure_of(FailureKind::kOther,
                          absl::ResourceExhaustedError(absl::StrFormat(
                              "%s: out of memory; give this process more memory (ulimit -v)", path)));
      }
    }));
  }
}

std::optional<FrameReader::Read> FrameReader::next() {
  if (reading_.empty()) return std::nullopt;
  const size_t index = at_ - reading_.size();
  absl::StatusOr<Image> image = reading_.front().get();
  reading_.pop_front();
  read_ahead();
  return Read{index, std::move(image)};
}

}  // namespace candela
