#include "client/image/read/image_stream.h"

#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfVersion.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "client/base/failure.h"
#include "client/image/image.h"
#include "client/image/read/exr_file.h"
#include "client/image/read/pfm_header.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kBuffered = 1u << 16, kTakenAtOnce = 1u << 20;

}  // namespace

ByteSource::ByteSource(int descriptor)
    : descriptor_(descriptor), stopped_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)), buffer_(kBuffered) {}

ByteSource::~ByteSource() {
  if (stopped_ >= 0) close(stopped_);
}

int ByteSource::get() {
  if (at_ == end_) {
    at_ = 0;
    end_ = read_some(buffer_.data(), buffer_.size());
    if (end_ == 0) return -1;
  }
  return static_cast<unsigned char>(buffer_[at_++]);
}

bool ByteSource::take(uint64_t count, std::string& bytes) {
  const size_t buffered = std::min<uint64_t>(count, end_ - at_);
  bytes.append(buffer_.data() + at_, buffered);
  at_ += buffered;
  for (uint64_t left = count - buffered; left > 0;) {
    const size_t had = bytes.size(), wanted = std::min<uint64_t>(left, kTakenAtOnce);
    bytes.resize(had + wanted);
    const size_t got = read_some(bytes.data() + had, wanted);
    bytes.resize(had + got);
    if (got == 0) return false;
    left -= got;
  }
  return true;
}

void ByteSource::stop() {
  const uint64_t one = 1;
  if (stopped_ >= 0) (void)!write(stopped_, &one, sizeof one);
}

absl::Status ByteSource::status() const {
  return error_ == 0 ? absl::OkStatus() : absl::ErrnoToStatus(error_, "cannot read");
}

size_t ByteSource::read_some(char* to, size_t most) {
  while (!ended_) {
    pollfd waits[] = {{descriptor_, POLLIN, 0}, {stopped_, POLLIN, 0}};  // poll() ignores -1
    if (poll(waits, 2, -1) < 0 && errno == EINTR) continue;
    if (waits[1].revents != 0) break;
    const ssize_t count = read(descriptor_, to, most);
    if (count > 0) return static_cast<size_t>(count);
    if (count < 0 && (errno == EINTR || errno == EAGAIN)) continue;
    if (count < 0) error_ = errno;
    break;
  }
  ended_ = true;
  return 0;
}

namespace {

// Takes an OpenEXR file from a pipe.

constexpr uint32_t kMostAttributeBytes = 64u << 20;  // a preview of 4096x4096

// See "file layout" in OpenEXR's technical introduction.
class ExrTaker {
 public:
  ExrTaker(ByteSource& source, const std::string& name, const ImageLimits& limits, std::string& bytes)
      : source_(source), name_(name), limits_(limits), bytes_(bytes) {}

  absl::Status take() {
    RETURN_IF_ERROR(take_header());
    if (ended_) return absl::OkStatus();
    ASSIGN_OR_RETURN(const uint64_t chunks, count_chunks());
    RETURN_IF_ERROR(append(chunks * 8));
    // A line's number, or a tile's place and level; then the size of what follows.
    const size_t head = tiles_ ? 20 : 8;
    for (uint64_t i = 0; i < chunks && !ended_; ++i) {
      RETURN_IF_ERROR(append(head));
      if (ended_) break;
      const uint32_t size = number_at(bytes_.size() - 4);
      if (size > limits_.max_chunk_bytes) {
        return absl::ResourceExhaustedError(
            absl::StrFormat("%s: chunk %d of %d claims %d bytes; --max-chunk-mib allows %d", name_, i + 1,
                            chunks, size, limits_.max_chunk_bytes));
      }
      RETURN_IF_ERROR(append(size));
    }
    return absl::OkStatus();
  }

 private:
  struct Tiles {
    uint32_t width = 0, height = 0;
    uint8_t mode = 0;  // levels in the low four bits: one, mipmap, ripmap; rounding up in the others
  };

  uint32_t number_at(size_t at) const {
    uint32_t value = 0;
    for (size_t i = 0; i < 4; ++i) value |= uint32_t{static_cast<unsigned char>(bytes_[at + i])} << 8 * i;
    return value;
  }

  absl::Status append(uint64_t count) {
    if (ended_) return absl::OkStatus();
    ASSIGN_OR_RETURN(const bool whole, take_piped(source_, name_, limits_, count, bytes_));
    ended_ = !whole;
    return absl::OkStatus();
  }

  absl::Status damaged(const std::string& what) const {
    return absl::InvalidArgumentError(absl::StrFormat("%s: damaged OpenEXR file: %s", name_, what));
  }

  // A name up to its zero byte, which it has at most 255 letters before. Nothing if it is longer.
  std::optional<std::string> take_name() {
    std::string name;
    while (name.size() <= 255) {
      const int byte = source_.get();
      ended_ = ended_ || byte < 0;
      if (ended_) return "";
      bytes_.push_back(static_cast<char>(byte));
      if (byte == 0) return name;
      name.push_back(static_cast<char>(byte));
    }
    return std::nullopt;
  }

  absl::Status take_header() {
    RETURN_IF_ERROR(append(4));
    if (ended_) return absl::OkStatus();
    const uint32_t version = number_at(4);
    tiles_ = (version & Imf::TILED_FLAG) != 0;
    if ((version & (Imf::NON_IMAGE_FLAG | Imf::MULTI_PART_FILE_FLAG)) != 0) {
      return absl::UnimplementedError(absl::StrFormat(
          "%s: an OpenEXR file of several parts, or a deep one; a pipe takes files of one part", name_));
    }
    while (true) {
      const std::optional<std::string> name = take_name();
      if (!name) return damaged("the header is not a complete list of attributes");
      if (ended_ || name->empty()) return absl::OkStatus();
      const std::optional<std::string> type = take_name();
      if (!type) return damaged("the header is not a complete list of attributes");
      RETURN_IF_ERROR(append(4));
      if (ended_) return absl::OkStatus();
      const uint32_t size = number_at(bytes_.size() - 4);
      if (size > kMostAttributeBytes) {
        return damaged(absl::StrFormat("attribute %s claims %d bytes; it may have %d in a pipe",
                                       printable(*name), size, kMostAttributeBytes));
      }
      RETURN_IF_ERROR(append(size));
      if (!ended_) keep(*name, *type, size);
    }
  }

  // Remembers an attribute that tells how many chunks there are. Its value is the last that was taken.
  void keep(const std::string& name, const std::string& type, uint32_t size) {
    const size_t at = bytes_.size() - size;
    const auto signed_at = [this, at](size_t i) {
      return int64_t{static_cast<int32_t>(number_at(at + 4 * i))};
    };
    if (name == "dataWindow" && type == "box2i" && size == 16) {
      width_ = signed_at(2) - signed_at(0) + 1;
      height_ = signed_at(3) - signed_at(1) + 1;
    } else if (name == "compression" && size == 1) {
      compression_ = static_cast<unsigned char>(bytes_[at]);
    } else if (name == "tiles" && type == "tiledesc" && size == 9) {
      tile_ = {number_at(at), number_at(at + 4), static_cast<uint8_t>(bytes_[at + 8])};
    }
  }

  absl::StatusOr<uint64_t> count_chunks() const {
    RETURN_IF_ERROR(check_image_size(name_, "data window", width_, height_, ImageFormat::kRgba16f, limits_));
    const auto width = static_cast<uint64_t>(width_), height = static_cast<uint64_t>(height_);
    if (!tiles_) {
      if (compression_ >= Imf::NUM_COMPRESSION_METHODS) {
        return damaged(
            absl::StrFormat("its compression is number %d, which this candela does not know", compression_));
      }
      const auto rows = static_cast<uint64_t>(rows_of_chunk(static_cast<Imf::Compression>(compression_)));
      return (height + rows - 1) / rows;
    }
    const int mode = tile_.mode & 15, up = tile_.mode >> 4;
    if (tile_.width < 1 || tile_.height < 1 || mode > 2 || up > 1) return damaged("its tiles have no size");
    const auto tiles_across = [&](uint64_t pixels, uint64_t tile, int level) {
      const uint64_t reduced = up ? (pixels + (uint64_t{1} << level) - 1) >> level : pixels >> level;
      return (std::max<uint64_t>(reduced, 1) + tile - 1) / tile;
    };
    const auto levels = [&](uint64_t pixels) {
      int count = 1;
      while ((uint64_t{1} << count) <= pixels) ++count;
      return up && (uint64_t{1} << (count - 1)) < pixels ? count + 1 : count;
    };
    if (mode == 2) {
      uint64_t across = 0, down = 0;
      for (int level = 0; level < levels(width); ++level) across += tiles_across(width, tile_.width, level);
      for (int level = 0; level < levels(height); ++level) down += tiles_across(height, tile_.height, level);
      return across * down;
    }
    uint64_t chunks = 0;
    const int count = mode == 1 ? levels(std::max(width, height)) : 1;
    for (int level = 0; level < count; ++level) {
      chunks += tiles_across(width, tile_.width, level) * tiles_across(height, tile_.height, level);
    }
    return chunks;
  }

  ByteSource& source_;
  const std::string& name_;
  const ImageLimits& limits_;
  std::string& bytes_;
  bool ended_ = false;  // the stream ended within the file
  int64_t width_ = 0, height_ = 0;
  int compression_ = 0;
  bool tiles_ = false;
  Tiles tile_;
};

// Reads the rest of a file of one part, whose first four bytes are in `bytes`, and appends it. The file's
// header and chunks say where it ends; chunks may come in any order. Also OK if the stream ends within the
// file. Fails if the file does not say how long it is, or is larger than a limit. `name` names the file in
// the error.
absl::Status take_exr(ByteSource& source, const std::string& name, const ImageLimits& limits,
                      std::string& bytes) {
  return ExrTaker(source, name, limits, bytes).take();
}

// Takes a PNG file from a pipe.

constexpr absl::string_view kPngSignature("\x89PNG\r\n\x1a\n", 8);
constexpr size_t kChunkHead = 8, kCrc = 4, kIhdrBytes = 13;

absl::Status not_png(const std::string& name, const std::string& what) {
  return absl::InvalidArgumentError(absl::StrFormat("%s: damaged PNG file: %s", name, what));
}

// Reads the rest of a file, whose first four bytes are in `bytes`, and appends it: the chunks up to IEND.
// Also OK if the stream ends within the file. Fails if the file does not say how long it is, or is larger
// than a limit. `name` names the file in the error.
absl::Status take_png(ByteSource& source, const std::string& name, const ImageLimits& limits,
                      std::string& bytes) {
  const auto take = [&](uint64_t count) { return take_piped(source, name, limits, count, bytes); };
  ASSIGN_OR_RETURN(bool whole, take(kPngSignature.size() - bytes.size()));
  if (whole && bytes != kPngSignature) return not_png(name, "its first 8 bytes are not those of a PNG");
  bool is_first = true, is_last = false;
  while (whole && !is_last) {
    ASSIGN_OR_RETURN(whole, take(kChunkHead));
    if (!whole) break;
    const size_t at = bytes.size() - kChunkHead;
    const uint32_t size = big_endian_at(bytes, at);
    const std::string kind = bytes.substr(at + 4, 4);
    if (is_first && (kind != "IHDR" || size != kIhdrBytes)) return not_png(name, "it begins without IHDR");
    ASSIGN_OR_RETURN(whole, take(uint64_t{size} + kCrc));
    if (is_first && whole) {
      RETURN_IF_ERROR(check_image_size(name, "image", big_endian_at(bytes, at + kChunkHead),
                                       big_endian_at(bytes, at + kChunkHead + 4), ImageFormat::kRgba32f,
                                       limits));
    }
    is_first = false;
    is_last = kind == "IEND";
  }
  return absl::OkStatus();
}

constexpr size_t kMostPfmHeader = 4096;  // with its comments
constexpr size_t kMostY4mLine = 4096;

// The bytes of a y4m up to the line end, which is taken, too.
absl::StatusOr<std::string> take_line(ByteSource& source, const std::string& name) {
  std::string line;
  for (int byte = source.get(); byte != '\n'; byte = source.get()) {
    if (byte < 0 || line.size() == kMostY4mLine) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: a line of the y4m does not end within %d bytes", name, kMostY4mLine));
    }
    line.push_back(static_cast<char>(byte));
  }
  return line;
}

}  // namespace

// Of an OpenEXR file, several channels are not rendered.
uint64_t most_piped_bytes(const ImageLimits& limits) { return 4 * limits.max_bytes; }

absl::StatusOr<bool> take_piped(ByteSource& source, const std::string& name, const ImageLimits& limits,
                                uint64_t count, std::string& bytes) {
  const uint64_t most = most_piped_bytes(limits);
  if (count > most - std::min<uint64_t>(bytes.size(), most)) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "%s: it takes more than the %d bytes that a file in a pipe may have; give it as a file", name, most));
  }
  return source.take(count, bytes);
}

std::string ImageStream::name() const { return absl::StrFormat("%s, frame %d", name_, count_); }

std::optional<absl::StatusOr<Image>> ImageStream::next() {
  if (!lost_.ok()) return std::nullopt;
  std::string bytes;
  const bool begins = source_.take(4, bytes);
  if (bytes.empty() && source_.status().ok()) return std::nullopt;
  ++count_;
  if (begins) lost_ = take_file(bytes);
  lost_.Update(source_.status());
  if (!lost_.ok()) {
    if (!absl::StartsWith(lost_.message(), name())) {
      lost_ = absl::Status(lost_.code(), absl::StrFormat("%s: %s", name(), lost_.message()));
    }
    lost_ = input_failure(lost_, name());
    return lost_;
  }
  return picture_of(std::move(bytes));
}

absl::StatusOr<Image> ImageStream::picture_of(std::string bytes) const {
  if (!has_planes_) return read_image_bytes(name(), std::move(bytes), limits_, choice_);
  if (const uint64_t wanted = y4m_->frame_bytes(); bytes.size() < wanted) {
    return input_failure(absl::InvalidArgumentError(absl::StrFormat(
                             "%s: the file is truncated: %d of %d bytes of the frame are missing", name(),
                             wanted - bytes.size(), wanted)),
                         name());
  }
  return y4m_->image(std::as_bytes(std::span(bytes)));
}

absl::Status ImageStream::take_file(std::string& bytes) {
  has_planes_ = false;
  if (bytes == kY4mMagic.substr(0, 4)) {
    RETURN_IF_ERROR(begin_y4m(bytes));
  }
  if (y4m_ && bytes == kY4mFrame.substr(0, 4)) return take_planes(bytes);
  if (bytes == "\x76\x2f\x31\x01") return take_exr(source_, name(), limits_, bytes);
  for (const char* pfm : {"PF", "Pf", "PH", "Ph"}) {
    if (absl::StartsWith(bytes, pfm)) return take_pfm(bytes);
  }
  if (bytes == "\x89PNG") return take_png(source_, name(), limits_, bytes);
  if (absl::StartsWith(bytes, "#?")) {
    return absl::UnimplementedError(absl::StrFormat(
        "%s: a Radiance file does not say where it ends; a pipe takes PFM, PHM, PNG, OpenEXR and y4m",
        name()));
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: here no PFM, PHM, PNG, OpenEXR or y4m begins, so what follows cannot be read", name()));
}

absl::Status ImageStream::take_pfm(std::string& bytes) {
  size_t at = 0;
  const auto get = [&]() -> int {
    if (at == bytes.size()) {
      const int byte = bytes.size() < kMostPfmHeader ? source_.get() : -1;
      if (byte < 0) return -1;
      bytes.push_back(static_cast<char>(byte));
    }
    return static_cast<unsigned char>(bytes[at++]);
  };
  PfmWords words(get);
  ASSIGN_OR_RETURN(const PfmHeader header, read_pfm_header(words, name(), limits_, choice_.rows));
  words.finish_line();
  bytes.reserve(bytes.size() + header.bytes());
  source_.take(header.bytes(), bytes);
  return absl::OkStatus();
}

absl::Status ImageStream::begin_y4m(std::string& bytes) {
  ASSIGN_OR_RETURN(const std::string line, take_line(source_, name()));
  ASSIGN_OR_RETURN(y4m_, Y4mFrames::of(name(), bytes + line, limits_, choice_));
  bytes.clear();
  if (source_.take(4, bytes)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat("%s: the y4m ends before its first frame", name()));
}

absl::Status ImageStream::take_planes(std::string& bytes) {
  ASSIGN_OR_RETURN(const std::string line, take_line(source_, name()));
  if (const std::string word = bytes + line; word != kY4mFrame && !absl::StartsWith(word, "FRAME ")) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: a y4m's frame begins with FRAME, and here is %s", name(), printable(word)));
  }
  bytes.clear();
  has_planes_ = true;
  source_.take(y4m_->frame_bytes(), bytes);
  return absl::OkStatus();
}

namespace {

absl::StatusOr<std::string> take_whole(int descriptor, const std::string& name, const ImageLimits& limits) {
  ByteSource source(descriptor);
  std::string bytes;
  if (source.take(most_piped_bytes(limits) + 1, bytes)) {
    return input_failure(absl::ResourceExhaustedError(absl::StrFormat(
                             "%s: it has more than %d bytes, the most of a file in a pipe; give it as a file",
                             name, most_piped_bytes(limits))),
                         name);
  }
  if (!source.status().ok()) {
    return input_failure(
        absl::Status(source.status().code(), absl::StrFormat("%s: %s", name, source.status().message())),
        name);
  }
  return bytes;
}

}  // namespace

absl::StatusOr<Image> read_piped_image(int descriptor, const std::string& name, const ImageLimits& limits,
                                       const PictureChoice& choice) {
  ASSIGN_OR_RETURN(std::string bytes, take_whole(descriptor, name, limits));
  return read_image_bytes(name, std::move(bytes), limits, choice);
}

absl::StatusOr<FileFacts> describe_piped_image(int descriptor, const std::string& name,
                                               const ImageLimits& limits) {
  ASSIGN_OR_RETURN(std::string bytes, take_whole(descriptor, name, limits));
  return describe_image_bytes(name, std::move(bytes), limits);
}

}  // namespace candela
