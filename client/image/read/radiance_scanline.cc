#include "client/image/read/radiance_scanline.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace candela {
namespace {

absl::Status damaged(const FileReader& file, int64_t index, const char* what) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: damaged Radiance file: %s in scan line %d", file.path(), what, index));
}

absl::Status truncated(const FileReader& file, int64_t index) {
  return file.truncated(absl::StrFormat("the rest of scan line %d", index));
}

// Decodes the four components, one after the other. Each is a sequence of runs (a count above 128, then the
// value) and literals.
absl::Status read_by_component(FileReader& file, int64_t index, std::span<Rgbe> line) {
  for (size_t c = 0; c < 4; ++c) {
    for (size_t i = 0; i < line.size();) {
      const int code = file.get();
      if (code < 0) return truncated(file, index);
      if (code == 0) return damaged(file, index, "a literal of no length");
      const size_t count = code > 128 ? code - 128 : code;
      if (count > line.size() - i) return damaged(file, index, "a run past the width");
      int value = code > 128 ? file.get() : 0;
      for (size_t k = 0; k < count; ++k) {
        if (code <= 128) value = file.get();
        if (value < 0) return truncated(file, index);
        line[i++][c] = static_cast<uint8_t>(value);
      }
    }
  }
  return absl::OkStatus();
}

// Decodes pixels. A record with mantissas 1 1 1 repeats the previous pixel as often as its exponent says.
// Further such records right after it are the higher bytes of the count. A line without them is flat. `pixel`
// is the first record, which was already taken from the file.
absl::Status read_by_pixel(FileReader& file, int64_t index, Rgbe pixel, std::span<Rgbe> line) {
  int shift = 0;
  for (size_t i = 0;;) {
    if (pixel[0] == 1 && pixel[1] == 1 && pixel[2] == 1) {
      if (i == 0) return damaged(file, index, "a run without a pixel before it");
      if (shift > 24) return damaged(file, index, "a run past the width");
      const uint64_t count = uint64_t{pixel[3]} << shift;
      if (count > line.size() - i) return damaged(file, index, "a run past the width");
      std::fill_n(line.begin() + static_cast<ptrdiff_t>(i), count, line[i - 1]);
      i += count;
      shift += 8;
    } else {
      line[i++] = pixel;
      shift = 0;
    }
    if (i == line.size()) return absl::OkStatus();
    if (!file.read(std::as_writable_bytes(std::span(pixel)))) return truncated(file, index);
  }
}

}  // namespace

absl::Status read_scanline(FileReader& file, int64_t index, std::span<Rgbe> line) {
  Rgbe start{};
  if (!file.read(std::as_writable_bytes(std::span(start)))) return truncated(file, index);
  const bool by_component =
      line.size() >= 8 && line.size() <= 0x7fff && start[0] == 2 && start[1] == 2 && start[2] < 128;
  if (!by_component) return read_by_pixel(file, index, start, line);
  if (size_t{start[2]} * 256 + start[3] != line.size()) {
    return damaged(file, index, "a length other than the header's");
  }
  return read_by_component(file, index, line);
}

}  // namespace candela
