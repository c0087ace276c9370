// Gives images in order: of files, read ahead, several at once; or of a pipe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <future>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "client/image/read/image_stream.h"
#include "client/run/sequence/sequence.h"

namespace candela {

// Used by one thread at a time.
class FrameReader {
 public:
  virtual ~FrameReader() = default;

  struct Read {
    size_t index;  // of its frame in the sequence
    absl::StatusOr<Image> image;
  };
  // Waits for the next image in order. Returns nothing after the last.
  virtual std::optional<Read> next() = 0;

  // Their number; 0 if it is not known.
  virtual uint64_t frames() const = 0;

  // Reads a file that is none of the frames.
  virtual absl::StatusOr<Image> read(const std::string& path) const = 0;

  // next() returns nothing more, also if it waits. Any thread.
  virtual void stop() {}
};

class FileFrameReader : public FrameReader {
 public:
  // Holds at most `ahead` (at least 1) images that next() has not returned yet.
  FileFrameReader(std::vector<std::string> paths, const ImageLimits& limits, size_t ahead,
                  PictureChoice choice = {});

  std::optional<Read> next() override;
  uint64_t frames() const override { return paths_.size(); }
  absl::StatusOr<Image> read(const std::string& path) const override {
    return read_image(path, limits_, choice_);
  }

 private:
  void read_ahead();

  const std::vector<std::string> paths_;
  const ImageLimits limits_;
  const PictureChoice choice_;
  const size_t ahead_;
  size_t at_ = 0;  // the next file to start reading
  std::deque<std::future<absl::StatusOr<Image>>> reading_;
};

// Reads standard input.
class PipedFrameReader : public FrameReader {
 public:
  // Adds each frame to the sequence as it comes; its number follows that of the frame before. The first is
  // `first`. `cuts` are the numbers of frames that begin a scene, ascending. The sequence must outlive this.
  PipedFrameReader(Sequence& sequence, int64_t first, std::vector<int64_t> cuts, const ImageLimits& limits,
                   PictureChoice choice);

  std::optional<Read> next() override;
  uint64_t frames() const override { return 0; }
  absl::StatusOr<Image> read(const std::string& path) const override;
  void stop() override { stream_.stop(); }

  // Why what follows the last frame cannot be read. Call it after the last next().
  const absl::Status& lost() const { return stream_.lost(); }

 private:
  Sequence& sequence_;
  int64_t number_;
  const std::vector<int64_t> cuts_;
  ImageStream stream_;
};

}  // namespace candela
