// Reads image files ahead, several at once.
#pragma once

#include <cstddef>
#include <deque>
#include <future>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/image/image.h"

namespace candela {

// Used by one thread at a time.
class FrameReader {
 public:
  // Holds at most `ahead` (at least 1) images that next() has not returned yet.
  FrameReader(std::vector<std::string> paths, const ImageLimits& limits, size_t ahead,
              PictureChoice choice = {});

  struct Read {
    size_t index;  // of its path in the list
    absl::StatusOr<Image> image;
  };
  // Waits for the next file in order. Returns nothing after the last.
  std::optional<Read> next();

  // Reads a file that is not in the list.
  absl::StatusOr<Image> read(const std::string& path) const { return read_image(path, limits_, choice_); }

 private:
  void read_ahead();

  const std::vector<std::string> paths_;
  const ImageLimits limits_;
  const PictureChoice choice_;
  const size_t ahead_;
  size_t at_ = 0;  // the next file to start reading
  std::deque<std::future<absl::StatusOr<Image>>> reading_;
};

}  // namespace candela
