// PFM: "PF" (RGB), "Pf" (grey) or "PF4" (RGB and alpha, an extension), width, height, scale, then floats,
// rows from the bottom. A negative scale means little endian; its magnitude multiplies the values.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

bool is_space(int c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

// The words of a header. Comments, from # to the end of the line, are skipped: the format knows none, but
// programs write them.
class HeaderWords {
 public:
  explicit HeaderWords(FileReader& file) : file_(file) {}

  // Takes the next word and the white-space byte after it. Returns "" at the end of the file or for a word of
  // more than 32 letters.
  std::string next() {
    std::string word;
    int byte = file_.get();
    crlf_ = crlf_ || (end_ == '\r' && byte == '\n');
    while (is_space(byte) || byte == '#') byte = byte == '#' ? after_comment() : file_.get();
    for (; byte >= 0 && !is_space(byte); byte = file_.get()) {
      if (word.size() == 32) return "";
      word.push_back(static_cast<char>(byte));
    }
    end_ = byte;
    return byte >= 0 ? word : "";
  }

  // Takes what is left of the last line after its last word: blanks, a comment, the LF of CR LF. Bytes that
  // the `wanted` bytes of pixels need are none of the header.
  void finish(uint64_t wanted) {
    while (end_ != '\n') {
      const absl::StatusOr<std::string> peeked = file_.peek(1);
      if (!peeked.ok() || peeked->empty()) return;
      const char byte = peeked->front();
      if (file_.remaining() <= wanted && !(crlf_ && end_ == '\r' && byte == '\n')) return;
      if (end_ == '\r' ? byte != '\n' : !is_space(byte) && byte != '#') return;
      end_ = file_.get();
      if (end_ == '#') end_ = after_comment();
    }
  }

 private:
  // Returns the line end, or -1 at the end of the file.
  int after_comment() {
    int byte = file_.get();
    while (byte >= 0 && byte != '\n') byte = file_.get();
    return byte;
  }

  FileReader& file_;
  int end_ = 0;        // the byte after the last word
  bool crlf_ = false;  // a line ended in CR LF
};

void to_rgba(const std::vector<uint32_t>& row, size_t components, bool swap, float scale, std::byte* out) {
  for (size_t i = 0; i < row.size(); i += components, out += 16) {
    float pixel[4] = {0, 0, 0, 1};
    for (size_t c = 0; c < std::max<size_t>(components, 3); ++c) {
      const uint32_t bits = row[i + (components == 1 ? 0 : c)];
      pixel[c] = std::bit_cast<float>(swap ? __builtin_bswap32(bits) : bits) * (c < 3 ? scale : 1);
    }
    std::memcpy(out, pixel, sizeof pixel);
  }
}

}  // namespace

absl::StatusOr<Image> read_pfm(FileReader& file, const ImageLimits& limits, bool fills_gaps) {
  HeaderWords words(file);
  const std::string kind = words.next(), width_text = words.next(), height_text = words.next(),
                    scale_text = words.next();
  int64_t width = 0, height = 0;
  double scale = 0;
  if ((kind != "PF" && kind != "Pf" && kind != "PF4") || !absl::SimpleAtoi(width_text, &width) ||
      !absl::SimpleAtoi(height_text, &height) || !absl::SimpleAtod(scale_text, &scale)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its PFM header is not 'PF', 'PF4' or 'Pf', width, height and scale, each "
                        "followed by white space",
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
  const size_t components = kind == "PF" ? 3 : kind == "PF4" ? 4 : 1;
  const uint64_t wanted = static_cast<uint64_t>(width * height) * components * sizeof(float);
  words.finish(wanted);
  const absl::Status cut =
      file.remaining() >= wanted
          ? absl::OkStatus()
          : file.truncated(absl::StrFormat("%d of %d bytes of pixels", wanted - file.remaining(), wanted));
  const uint64_t row_bytes = static_cast<uint64_t>(width) * components * sizeof(float);
  if (!cut.ok() && file.remaining() < row_bytes) return cut;
  if (!cut.ok() && !fills_gaps) return or_fill(cut);

  absl::StatusOr<Image> image =
      make_image(static_cast<uint32_t>(width), static_cast<uint32_t>(height), kFormat);
  if (!image.ok()) return image;
  image->has_alpha = components == 4;
  if (factor != 1) image->notes.push_back(absl::StrFormat("PFM scale %g multiplied in", factor));
  std::vector<uint32_t> row(static_cast<size_t>(width) * components);
  for (uint32_t y = image->height; y-- > 0;) {
    if (file.remaining() < row_bytes) {
      note_missing(file.path(), cut, (uint64_t{y} + 1) * image->width, *image);
      break;
    }
    if (!file.read(std::as_writable_bytes(std::span(row)))) return file.truncated("the rest of the pixels");
    to_rgba(row, components, scale > 0, factor, image->pixels.data() + y * image->row_bytes());
  }
  return image;
}

}  // namespace candela
