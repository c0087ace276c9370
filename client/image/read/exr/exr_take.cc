#include "client/image/read/exr/exr_take.h"

#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfVersion.h>

#include <algorithm>
#include <cstring>
#include <optional>

#include "absl/strings/str_format.h"
#include "client/image/read/exr/exr_checks.h"
#include "client/image/read/image_stream.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

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

}  // namespace

absl::Status take_exr(ByteSource& source, const std::string& name, const ImageLimits& limits,
                      std::string& bytes) {
  return ExrTaker(source, name, limits, bytes).take();
}

}  // namespace candela
