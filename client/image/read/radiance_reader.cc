// Reads Radiance .hdr files (RGBE and XYZE), after Greg Ward's color.c and resolu.c in the Radiance sources.
//
// The code is our own because of what we measured. OpenImageIO 2.4 silently decodes the old run-length scheme
// to zeros, ignores the order of rows, and needs 120 packages. stb_image fills truncated files with zeros.
//
// Choices: a component is mantissa / 256 * 2^(exponent - 128), without the half that some decoders add. The
// header's EXPOSURE is divided out. PRIMARIES are used; without them, and if all are 0, the colours are
// Rec.709. COLORCORR and GAMMA are only reported: Radiance's own programs do not know a GAMMA. XYZE is
// returned as CIE XYZ with the chromaticities of XYZ.
#include <algorithm>
#include <array>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <optional>
#include <span>
#include <system_error>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/charconv.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/image/color.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

struct Header {
  bool xyz = false;
  double exposure = 1.0;         // product of the EXPOSURE lines
  double height_to_width = 1.0;  // product of the PIXASPECT lines, which are height over width
  std::vector<std::string> color_corrections;
  std::string primaries;
  std::vector<std::string> notes;
};

// "-Y 48 +X 64": the first axis counts scan lines, the second the pixels along one.
struct Resolution {
  bool columns = false;  // scan lines are columns
  bool down = true;      // from the top: Radiance's y decreases
  bool right = true;     // from the left: x increases
  int64_t width = 0, height = 0;
};

// The number that a text begins with, as C's atof() reads it: white space before it and anything behind it do
// not matter. Nothing if it begins with none.
std::optional<double> number(absl::string_view text) {
  text = absl::StripLeadingAsciiWhitespace(text);
  absl::ConsumePrefix(&text, "+");
  double value = 0;
  const absl::from_chars_result result = absl::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec == std::errc::invalid_argument) return std::nullopt;
  return value;
}

// Multiplies a factor of the header, or leaves a note if its text is no number.
void multiply(const char* name, absl::string_view text, double& product, std::vector<std::string>& notes) {
  if (const std::optional<double> value = number(text)) {
    product *= *value;
  } else {
    notes.push_back(absl::StrFormat("%s %s is no number and was ignored", name, printable(text)));
  }
}

absl::Status read_header(FileReader& file, Header& header) {
  constexpr size_t kMaxLine = 4096;
  constexpr int kMaxLines = 1024;
  std::string line;
  bool is_begun = false;  // empty lines before its first words do not end it
  for (int i = 0; i < kMaxLines; ++i) {
    if (!file.read_line(line, kMaxLine)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: the Radiance header does not end with an empty line and an image size", file.path()));
    }
    absl::string_view text = absl::StripSuffix(line, "\r");
    if (text.empty() && is_begun) return absl::OkStatus();
    is_begun = is_begun || absl::StartsWith(text, "#?") || absl::StartsWith(text, "FORMAT=");
    if (absl::ConsumePrefix(&text, "FORMAT=")) {
      header.xyz = absl::StripAsciiWhitespace(text) == "32-bit_rle_xyze";
      if (!header.xyz && absl::StripAsciiWhitespace(text) != "32-bit_rle_rgbe") {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: the Radiance format is %s; only 32-bit_rle_rgbe and 32-bit_rle_xyze can be read",
            file.path(), printable(text)));
      }
    } else if (absl::ConsumePrefix(&text, "EXPOSURE=")) {
      multiply("EXPOSURE", text, header.exposure, header.notes);
    } else if (absl::ConsumePrefix(&text, "PIXASPECT=")) {
      multiply("PIXASPECT", text, header.height_to_width, header.notes);
    } else if (absl::ConsumePrefix(&text, "GAMMA=")) {
      const std::optional<double> gamma = number(text);
      if (gamma != 1.0) {
        header.notes.push_back(absl::StrFormat("GAMMA %s was ignored: a Radiance file holds linear light",
                                               printable(absl::StripAsciiWhitespace(text))));
      }
    } else if (absl::ConsumePrefix(&text, "COLORCORR=")) {
      header.color_corrections.emplace_back(absl::StripAsciiWhitespace(text));
    } else if (absl::ConsumePrefix(&text, "PRIMARIES=")) {
      header.primaries = std::string(text);
    }
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: the Radiance header has more than %d lines", file.path(), kMaxLines));
}

absl::StatusOr<Resolution> read_resolution(FileReader& file) {
  std::string line;
  const bool read = file.read_line(line, 128);
  const std::vector<std::string> words =
      absl::StrSplit(absl::StripSuffix(line, "\r"), ' ', absl::SkipEmpty());
  const auto is_axis = [](const std::string& word) {
    return word.size() == 2 && (word[0] == '+' || word[0] == '-') && (word[1] == 'X' || word[1] == 'Y');
  };
  int64_t first = 0, second = 0;
  if (!read || words.size() != 4 || !is_axis(words[0]) || !is_axis(words[2]) || words[0][1] == words[2][1] ||
      !absl::SimpleAtoi(words[1], &first) || !absl::SimpleAtoi(words[3], &second)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the Radiance header has no image size such as '-Y 480 +X 640'", file.path()));
  }
  Resolution r{.columns = words[0][1] == 'X'};
  const std::string& x = words[r.columns ? 0 : 2];
  const std::string& y = words[r.columns ? 2 : 0];
  r.right = x[0] == '+';
  r.down = y[0] == '-';
  r.width = r.columns ? first : second;
  r.height = r.columns ? second : first;
  return r;
}

void apply_header(const Header& header, Image& image) {
  image.notes = header.notes;
  if (header.xyz) {
    set_chromaticities(kXyz.xy, image);
  } else if (!header.primaries.empty()) {
    std::array<float, 8> xy{};
    const std::vector<std::string> words =
        absl::StrSplit(header.primaries, absl::ByAnyChar(" \t\r"), absl::SkipEmpty());
    bool good = words.size() >= xy.size();
    for (size_t i = 0; good && i < xy.size(); ++i) {
      const std::optional<double> value = number(words[i]);
      good = value.has_value();
      xy[i] = static_cast<float>(value.value_or(0));
    }
    if (!good) {
      image.notes.push_back("the file's PRIMARIES are not eight numbers and were ignored");
    } else if (xy != std::array<float, 8>{}) {  // Poly Haven's files have eight zeros, which name nothing
      set_chromaticities(xy, image);
    }
  }
  for (const std::string& correction : header.color_corrections) {
    image.notes.push_back(absl::StrFormat("COLORCORR %s was not divided out", printable(correction)));
  }
  if (header.height_to_width != 1.0) set_pixel_aspect(1.0 / header.height_to_width, image);
}

// The factor for all values. If the header's is unusable, 1 with a note.
double radiance_scale(const Header& header, Image& image) {
  if (header.exposure == 1.0) return 1.0;
  if (!std::isfinite(header.exposure) || header.exposure < 1e-30 || header.exposure > 1e30) {
    image.notes.push_back(
        absl::StrFormat("EXPOSURE %g is not within 1e-30 .. 1e30 and was ignored", header.exposure));
    return 1.0;
  }
  image.notes.push_back(absl::StrFormat("EXPOSURE %g divided out", header.exposure));
  return 1.0 / header.exposure;
}

using Rgbe = std::array<uint8_t, 4>;  // three mantissas and their common exponent

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

// Decodes a scan line: flat, run-length coded by component, or by pixel as before 1991.
// Fills `line`, which has the scan line's length. `index` is for error messages. Returns INVALID_ARGUMENT if
// the file ends within the line or its runs do not fit the length.
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

}  // namespace

absl::StatusOr<Image> read_radiance(FileReader& file, const ImageLimits& limits, bool fills_gaps) {
  Header header;
  RETURN_IF_ERROR(read_header(file, header));
  ASSIGN_OR_RETURN(Resolution r, read_resolution(file));
  constexpr ImageFormat kFormat = ImageFormat::kRgba32f;
  if (absl::Status status = check_image_size(file.path(), "image", r.width, r.height, kFormat, limits);
      !status.ok()) {
    return status;
  }
  const int64_t lines = r.columns ? r.width : r.height, length = r.columns ? r.height : r.width;
  // Every scan line takes at least one record of four bytes.
  if (!fills_gaps && file.remaining() < static_cast<uint64_t>(lines) * 4) {
    return or_fill(file.truncated(absl::StrFormat("most of its %d scan lines", lines)));
  }

  absl::StatusOr<Image> image =
      make_image(static_cast<uint32_t>(r.width), static_cast<uint32_t>(r.height), kFormat);
  if (!image.ok()) return image;
  apply_header(header, *image);
  const double scale = radiance_scale(header, *image);
  // 2^(e-128) / 256 / exposure for every exponent. Exponent 0 is black with any mantissa. The scales are
  // finite, so that a mantissa of 0 stays 0.
  std::array<float, 256> factor{};
  for (int e = 1; e < 256; ++e) {
    factor[e] = static_cast<float>(std::min<double>(std::ldexp(scale, e - 136), FLT_MAX));
  }

  const auto row_bytes = static_cast<int64_t>(image->row_bytes());
  const int64_t x_step = r.right ? 16 : -16, y_step = r.down ? row_bytes : -row_bytes;
  const int64_t line_step = r.columns ? x_step : y_step, pixel_step = r.columns ? y_step : x_step;
  const int64_t first = (r.right ? 0 : row_bytes - 16) + (r.down ? 0 : (r.height - 1) * row_bytes);
  std::vector<Rgbe> line(static_cast<size_t>(length));
  for (int64_t i = 0; i < lines; ++i) {
    if (absl::Status status = read_scanline(file, i, line); !status.ok()) {
      // Where the next scan line begins is not known.
      if (!fills_gaps || i == 0) return i == 0 ? status : or_fill(status);
      note_missing(file.path(), status, static_cast<uint64_t>((lines - i) * length), *image);
      break;
    }
    int64_t at = first + i * line_step;
    for (const Rgbe& v : line) {
      const float f = factor[v[3]];
      const float pixel[4] = {f * v[0], f * v[1], f * v[2], 1};
      std::memcpy(image->pixels.data() + at, pixel, sizeof pixel);
      at += pixel_step;
    }
  }
  return image;
}

}  // namespace candela
