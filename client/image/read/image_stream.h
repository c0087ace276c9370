// Images from a pipe, one after the other.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/describe.h"
#include "client/image/image.h"
#include "client/image/read/y4m_frames.h"

namespace candela {

// Reads a descriptor that may be a pipe, buffered. Internal to client/image.
//
// Used by one thread, but for stop().
class ByteSource {
 public:
  explicit ByteSource(int descriptor);
  ~ByteSource();
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;

  // Takes the next byte. Returns -1 at the end.
  int get();

  // Appends the next `count` bytes. False if there are fewer; then it appends these. It takes memory as the
  // bytes come.
  bool take(uint64_t count, std::string& bytes);

  // Ends the stream, also for a get() or take() that waits. Any thread.
  void stop();

  // Why the stream cannot be read. OK at its end, and after stop().
  absl::Status status() const;

 private:
  // Reads what is there, at least a byte. Returns the number of bytes, 0 at the end.
  size_t read_some(char* to, size_t most);

  const int descriptor_;
  const int stopped_;  // an eventfd, or -1 if the system gave none
  std::vector<char> buffer_;
  size_t at_ = 0, end_ = 0;  // in the buffer
  int error_ = 0;            // an errno
  bool ended_ = false;
};

// Images that come one after another through a pipe.

inline constexpr char kStdinName[] = "standard input";

// The most bytes that one file in a pipe may have.
uint64_t most_piped_bytes(const ImageLimits& limits);

// Reads the next `count` bytes of a file and appends them to `bytes`. False if the stream ends before.
// RESOURCE_EXHAUSTED if the file would become larger than most_piped_bytes(). `name` names the file in the
// error.
absl::StatusOr<bool> take_piped(ByteSource& source, const std::string& name, const ImageLimits& limits,
                                uint64_t count, std::string& bytes);

// Reads PFM, PHM, PNG and OpenEXR files of one part, and the frames of y4m. These say themselves how long
// they are, so nothing has to be between them. Each is read into memory whole, and then decoded as a file is.
// Used by one thread, but for stop().
class ImageStream {
 public:
  // `descriptor` is read until its end, and stays open. `name` names it in messages.
  ImageStream(int descriptor, std::string name, const ImageLimits& limits, PictureChoice choice)
      : source_(descriptor), name_(std::move(name)), limits_(limits), choice_(std::move(choice)) {}

  // The next image, or why it cannot be read; nothing at the end of the stream. If it is not known where an
  // image ends, it is the last one, and lost() says why.
  std::optional<absl::StatusOr<Image>> next();

  // Why the rest of the stream cannot be read.
  const absl::Status& lost() const { return lost_; }

  // "NAME, frame 3": the image that next() returned last.
  std::string name() const;

  // Makes next() return nothing, also while it waits. Any thread.
  void stop() { source_.stop(); }

 private:
  // Reads the rest of a file, whose first bytes are in `bytes`. Also OK if the stream ends within the file.
  absl::Status take_file(std::string& bytes);
  absl::Status take_pfm(std::string& bytes);
  // After the first four bytes of a y4m: reads its header, and the first four bytes of a frame.
  absl::Status begin_y4m(std::string& bytes);
  // After the first four bytes of a y4m's frame: reads its planes, which replace them in `bytes`.
  absl::Status take_planes(std::string& bytes);
  absl::StatusOr<Image> picture_of(std::string bytes) const;

  ByteSource source_;
  const std::string name_;
  const ImageLimits limits_;
  const PictureChoice choice_;
  uint64_t count_ = 0;  // images so far
  std::optional<Y4mFrames> y4m_;
  bool has_planes_ = false;  // the bytes that were read last are a frame of y4m_
  absl::Status lost_;
};

// Reads the image of any kind that the whole stream is. Errors name it as `name`.
absl::StatusOr<Image> read_piped_image(int descriptor, const std::string& name, const ImageLimits& limits,
                                       const PictureChoice& choice);

// Describes it, as describe_image() does a file.
absl::StatusOr<FileFacts> describe_piped_image(int descriptor, const std::string& name,
                                               const ImageLimits& limits);

}  // namespace candela
