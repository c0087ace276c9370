// PFM: "PF" (RGB) or "Pf" (grey), width, height, scale, then floats, rows from the bottom. A negative scale
// means little endian; its magnitude multiplies the values.
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

// Takes the next word of the header and the white-space byte after it. Returns "" at the end of the file or
// for a word of more than 32 letters.
std::string next_word(FileReader& file) {
  const auto is_space = [](int c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; };
  std::string word;
  int byte = file.get();
  while (is_space(byte)) byte = file.get();
  for (; byte >= 0 && !is_space(byte); byte = file.get()) {
    if (word.size() == 32) return "";
    word.push_back(static_cast<char>(byte));
  }
  return byte >= 0 ? word : "";
}

void to_rgba(const std::vector<uint32_t>& row, size_t components, bool swap, float scale, std::byte* out) {
  for (size_t i = 0; i < row.size(); i += components, out += 16) {
    float pixel[4] = {0, 0, 0, 1};
    for (size_t c = 0; c < 3; ++c) {
      const uint32_t bits = row[i + (components == 3 ? c : 0)];
      pixel[c] = std::bit_cast<float>(swap ? __builtin_bswap32(bits) : bits) * scale;
    }
    std::memcpy(out, pixel, sizeof pixel);
  }
}

}  // namespace

absl::StatusOr<Image> read_pfm(FileReader& file, const ImageLimits& limits) {
  const std::string kind = next_word(file), width_text = next_word(file), height_text = next_word(file),
                    scale_text = next_word(file);
  int64_t width = 0, height = 0;
  double scale = 0;
  if ((kind != "PF" && kind != "Pf") || !absl::SimpleAtoi(width_text, &width) ||
      !absl::SimpleAtoi(height_text, &height) || !absl::SimpleAtod(scale_text, &scale)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: its PFM header is not 'PF' or 'Pf', width, height and scale, each followed by white space",
        file.path()));
  }
  const auto factor = static_cast<float>(std::fabs(scale));
  if (!std::isfinite(factor) || factor == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the PFM scale is %s; it must be a finite float other than 0", file.path(),
                        printable(scale_text)));
  }
  constexpr ImageFormat kFormat = ImageFormat::kRgba32f;
  if (absl::Status status = check_image_size(file.path(), "image", width, height, kFormat, limits);
      !status.ok()) {
    return status;
  }
  const size_t components = kind == "PF" ? 3 : 1;
  const uint64_t wanted = static_cast<uint64_t>(width * height) * components * sizeof(float);
  if (file.remaining() < wanted) {
    return file.truncated(absl::StrFormat("%d of %d bytes of pixels", wanted - file.remaining(), wanted));
  }

  absl::StatusOr<Image> image =
      make_image(static_cast<uint32_t>(width), static_cast<uint32_t>(height), kFormat);
  if (!image.ok()) return image;
  if (factor != 1) image->notes.push_back(absl::StrFormat("PFM scale %g multiplied in", factor));
  std::vector<uint32_t> row(static_cast<size_t>(width) * components);
  for (uint32_t y = image->height; y-- > 0;) {
    if (!file.read(std::as_writable_bytes(std::span(row)))) return file.truncated("the rest of the pixels");
    to_rgba(row, components, scale > 0, factor, image->pixels.data() + y * image->row_bytes());
  }
  return image;
}

}  // namespace candela
