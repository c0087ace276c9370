// PFM: "PF" (RGB), "Pf" (grey) or "PF4" (RGB and alpha, an extension), width, height, scale, then floats,
// rows from the bottom. A negative scale means little endian; its magnitude multiplies the values. PHM is
// ffmpeg's: "PH" or "Ph", the same with halves, and rows from the top.
#include <half.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "client/image/read/pfm_header.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

bool is_space(int c) { return c == ' ' || c == '\t' || c == '\n' || c == '\r'; }

// The words of a file, which knows its length.
class FileWords : public PfmWords {
 public:
  FileWords(FileReader& file, absl::FunctionRef<int()> get) : PfmWords(get), file_(file) {}

  // Takes what is left of the last line after its last word: blanks, a comment, the LF of CR LF. Bytes that
  // the `wanted` bytes of pixels need are none of the header.
  void finish(uint64_t wanted) {
    while (end_ != '\n') {
      const absl::StatusOr<std::string> peeked = file_.peek(1);
      if (!peeked.ok() || peeked->empty()) return;
      const char byte = peeked->front();
      if (file_.remaining() <= wanted && !(crlf_ && end_ == '\r' && byte == '\n')) return;
      if (end_ == '\r' ? byte != '\n' : !is_space(byte) && byte != '#') return;
      end_ = get_();
      if (end_ == '#') end_ = after_comment();
    }
  }

 private:
  FileReader& file_;
};

uint32_t swapped(uint32_t bits) { return __builtin_bswap32(bits); }
uint16_t swapped(uint16_t bits) { return __builtin_bswap16(bits); }
float value_of(uint32_t bits) { return std::bit_cast<float>(bits); }
float value_of(uint16_t bits) { return imath_half_to_float(bits); }

// Bits are those of the file's components: floats or halves. `make` turns them into a component of the image;
// the second argument says whether it is one of colour.
template <typename Bits, typename Make, typename Component>
void to_rgba(const std::byte* row, const PfmHeader& header, Component one, Make make, std::byte* out) {
  for (uint32_t x = 0; x < header.width; ++x, out += 4 * sizeof(Component)) {
    Component pixel[4] = {one, one, one, one};
    for (size_t c = 0; c < std::max<size_t>(header.components, 3); ++c) {
      Bits bits;
      std::memcpy(&bits, row + (x * header.components + (header.components == 1 ? 0 : c)) * sizeof bits,
                  sizeof bits);
      pixel[c] = make(header.swap ? swapped(bits) : bits, c < 3);
    }
    std::memcpy(out, pixel, sizeof pixel);
  }
}

void to_rgba(const std::byte* row, const PfmHeader& header, std::byte* out) {
  const auto multiplied = [&header](auto bits, bool colour) {
    return value_of(bits) * (colour ? header.factor : 1);
  };
  if (!header.halves) {
    to_rgba<uint32_t>(row, header, 1.0f, multiplied, out);
  } else if (header.format() == ImageFormat::kRgba32f) {
    to_rgba<uint16_t>(row, header, 1.0f, multiplied, out);
  } else {
    constexpr uint16_t kOne = 0x3c00;
    to_rgba<uint16_t>(
        row, header, kOne, [](uint16_t bits, bool) { return bits; }, out);
  }
}

}  // namespace

std::string PfmWords::next() {
  std::string word;
  int byte = get_();
  crlf_ = crlf_ || (end_ == '\r' && byte == '\n');
  while (is_space(byte) || byte == '#') byte = byte == '#' ? after_comment() : get_();
  for (; byte >= 0 && !is_space(byte); byte = get_()) {
    if (word.size() == 32) return "";
    word.push_back(static_cast<char>(byte));
  }
  end_ = byte;
  return byte >= 0 ? word : "";
}

int PfmWords::after_comment() {
  int byte = get_();
  while (byte >= 0 && byte != '\n') byte = get_();
  return byte;
}

absl::StatusOr<PfmHeader> read_pfm_header(PfmWords& words, const std::string& path, const ImageLimits& limits,
                                          RowOrder rows) {
  const std::string kind = words.next(), width_text = words.next(), height_text = words.next(),
                    scale_text = words.next();
  PfmHeader header;
  header.halves = kind == "PH" || kind == "Ph";
  int64_t width = 0, height = 0;
  double scale = 0;
  if ((kind != "PF" && kind != "Pf" && kind != "PF4" && !header.halves) ||
      !absl::SimpleAtoi(width_text, &width) || !absl::SimpleAtoi(height_text, &height) ||
      !absl::SimpleAtod(scale_text, &scale)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its PFM header is not 'PF', 'PF4' or 'Pf', width, height and scale, each "
                        "followed by white space",
                        path));
  }
  header.factor = static_cast<float>(std::fabs(scale));
  if (!std::isfinite(header.factor) || header.factor == 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: the PFM scale is %s; it must be a finite float other than 0", path, printable(scale_text)));
  }
  RETURN_IF_ERROR(check_image_size(path, "image", width, height, header.format(), limits));
  header.width = static_cast<uint32_t>(width);
  header.height = static_cast<uint32_t>(height);
  header.components = kind == "PF4" ? 4 : kind == "PF" || kind == "PH" ? 3 : 1;
  header.swap = scale > 0;
  header.top_first = rows == RowOrder::kTop || (rows == RowOrder::kByKind && header.halves);
  return header;
}

absl::StatusOr<Image> read_pfm(FileReader& file, const ImageLimits& limits, const PictureChoice& choice) {
  const auto get = [&file] { return file.get(); };
  FileWords words(file, get);
  ASSIGN_OR_RETURN(const PfmHeader header, read_pfm_header(words, file.path(), limits, choice.rows));
  const uint64_t wanted = header.bytes(), row_bytes = header.row_bytes();
  words.finish(wanted);
  const absl::Status cut =
      file.remaining() >= wanted
          ? absl::OkStatus()
          : file.truncated(absl::StrFormat("%d of %d bytes of pixels", wanted - file.remaining(), wanted));
  if (!cut.ok() && file.remaining() < row_bytes) return cut;
  if (!cut.ok() && !choice.fills_gaps) return or_fill(cut);

  absl::StatusOr<Image> image =
      (cut.ok() ? image_to_overwrite : make_image)(header.width, header.height, header.format());
  if (!image.ok()) return image;
  image->has_alpha = header.components == 4;
  if (header.factor != 1) {
    image->notes.push_back(absl::StrFormat("PFM scale %g multiplied in", header.factor));
  }
  std::vector<std::byte> row(row_bytes);
  for (uint32_t taken = 0; taken < image->height; ++taken) {
    const uint32_t left = image->height - taken;
    if (file.remaining() < row_bytes) {
      note_missing(file.path(), cut, uint64_t{left} * image->width, *image);
      break;
    }
    if (!file.read(row)) return file.truncated("the rest of the pixels");
    const uint32_t y = header.top_first ? taken : left - 1;
    to_rgba(row.data(), header, image->pixels.data() + y * image->row_bytes());
  }
  return image;
}

}  // namespace candela
