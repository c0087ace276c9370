#include "client/image/read/y4m_frames.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include "client/image/read/neighbours.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

struct Ratio {
  uint64_t over = 0, under = 0;  // 0: not known
  bool is_known() const { return over > 0 && under > 0; }
};

// "25:1"; "0:0" is not known, and what is none is not, either.
Ratio ratio_of(absl::string_view text) {
  Ratio ratio;
  const std::vector<std::string> parts = absl::StrSplit(text, ':');
  if (parts.size() != 2 || !absl::SimpleAtoi(parts[0], &ratio.over) ||
      !absl::SimpleAtoi(parts[1], &ratio.under)) {
    return {};
  }
  return ratio;
}

bool has_wide_primaries(const PictureChoice& choice) {
  if (!choice.primaries) {
    return choice.transfer == SignalTransfer::kPq || choice.transfer == SignalTransfer::kHlg;
  }
  const NamedPrimaries* known = find_primaries(*choice.primaries);
  return known != nullptr && absl::string_view(known->name) == "Rec.2020";
}

// The matrix that the user names, else that of the primaries, else the one that the size lets expect.
absl::StatusOr<LumaMatrix> matrix_of(const std::string& name, const PictureChoice& choice, int64_t height) {
  if (!choice.matrix) {
    return has_wide_primaries(choice) ? kRec2020Luma : height < kHdLines ? kRec601Luma : kRec709Luma;
  }
  const auto* const known = std::ranges::find(kLumaMatrices, *choice.matrix, &LumaMatrix::code);
  if (known != std::end(kLumaMatrices)) return *known;
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: --input-matrix names matrix %d of H.273, which a y4m does not have; give another one, or leave it "
      "out",
      name, *choice.matrix));
}

uint32_t code_at(std::span<const std::byte> plane, uint64_t at, int bits) {
  if (bits == 8) return std::to_integer<uint32_t>(plane[at]);
  return std::to_integer<uint32_t>(plane[2 * at]) | std::to_integer<uint32_t>(plane[2 * at + 1]) << 8;
}

// The chroma samples around luma sample `at`. Halved chroma sample i lies at luma's 2 i, or at 2 i + 0.5 if
// it is centred.
Neighbours chroma_around(uint32_t at, uint32_t count, bool halved, bool centred) {
  if (!halved) return {at, at, 0};
  return neighbours_of((centred ? at - 0.5 : at) / 2, count);
}

uint16_t code_of_signal(float signal) {
  return static_cast<uint16_t>(std::clamp(signal, 0.0f, 1.0f) * 65535 + 0.5f);
}

}  // namespace

// 10 bits of 4:2:0 have no word for their place: readers take it as 420mpeg2's.
const Y4mFrames::Chroma Y4mFrames::kChromas[] = {
    {"420jpeg", 8, false, true, true, true}, {"420mpeg2", 8, false, true, true, false},
    {"420", 8, false, true, true, true},     {"420p10", 10, false, true, true, false},
    {"422", 8, false, true, false, false},   {"422p10", 10, false, true, false, false},
    {"444", 8, false, false, false, false},  {"444p10", 10, false, false, false, false},
    {"mono", 8, true, false, false, false},  {"mono10", 10, true, false, false, false},
};

absl::StatusOr<Y4mFrames> Y4mFrames::of(const std::string& name, absl::string_view header,
                                        const ImageLimits& limits, const PictureChoice& choice) {
  int64_t width = 0, height = 0;
  std::string colour = "420jpeg";
  bool full = false, interlaced = false;
  Ratio aspect, rate;
  if (!absl::ConsumePrefix(&header, absl::StrCat(kY4mMagic, " "))) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its y4m header does not begin with %s", name, kY4mMagic));
  }
  for (absl::string_view word : absl::StrSplit(header, ' ', absl::SkipEmpty())) {
    const absl::string_view value = word.substr(1);
    bool good = true;
    if (word[0] == 'W') good = absl::SimpleAtoi(value, &width);
    if (word[0] == 'H') good = absl::SimpleAtoi(value, &height);
    if (word[0] == 'C') colour = std::string(value);
    if (word[0] == 'F') rate = ratio_of(value);
    if (word[0] == 'A') aspect = ratio_of(value);
    if (word[0] == 'I') interlaced = value != "p" && value != "?";
    if (word == "XCOLORRANGE=FULL") full = true;
    if (!good) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: its y4m header says %s, which is no size", name, printable(word)));
    }
  }
  RETURN_IF_ERROR(check_image_size(name, "image", width, height, ImageFormat::kRgba32f, limits));
  const Chroma* const known = std::ranges::find(kChromas, absl::string_view(colour), &Chroma::word);
  if (known == std::end(kChromas)) {
    return absl::UnimplementedError(absl::StrFormat(
        "%s: its y4m planes are %s; Candela reads 420jpeg, 420mpeg2, 422, 444 and mono of 8 bits, and "
        "420p10, 422p10, 444p10 and mono10",
        name, printable(colour)));
  }
  ASSIGN_OR_RETURN(const LumaMatrix matrix, matrix_of(name, choice, height));
  Y4mFrames frames(*known, matrix, SignalDecoder({.source = ""}, choice));
  frames.width_ = static_cast<uint32_t>(width);
  frames.height_ = static_cast<uint32_t>(height);
  frames.full_ = choice.full_range.value_or(full);
  if (aspect.is_known()) {
    frames.pixel_aspect_ = static_cast<double>(aspect.over) / static_cast<double>(aspect.under);
  }
  if (rate.is_known()) frames.rate_ = FrameRate{rate.over, rate.under};
  if (interlaced) frames.notes_.emplace_back("the y4m is interlaced: its frames are shown as they are");
  if (!choice.transfer && !choice.keeps_signal) {
    frames.notes_.emplace_back(
        "y4m does not name its transfer: taken as sRGB; --input-transfer names another one");
  }
  if (!choice.matrix && !known->none && matrix.code == kRec601Luma.code) {
    frames.notes_.push_back(absl::StrFormat(
        "y4m does not name its matrix: taken as BT.601, as of fewer than %d lines; --input-matrix names "
        "another one",
        kHdLines));
  }
  return frames;
}

uint64_t Y4mFrames::frame_bytes() const {
  const uint64_t luma = uint64_t{width_} * height_;
  const uint64_t chroma = chroma_.none ? 0 : uint64_t{chroma_width()} * chroma_height();
  return (luma + 2 * chroma) * (chroma_.bits == 8 ? 1 : 2);
}

void Y4mFrames::chroma_row(std::span<const std::byte> plane, uint32_t y, std::span<float> row) const {
  if (chroma_.none) {
    std::ranges::fill(row, 0.0f);
    return;
  }
  const auto most = static_cast<float>((1 << chroma_.bits) - 1),
             middle = static_cast<float>(1 << (chroma_.bits - 1));
  const float range = full_ ? most : 224.0f * static_cast<float>(1 << (chroma_.bits - 8));
  const uint32_t width = chroma_width();
  const Neighbours down = chroma_around(y, chroma_height(), chroma_.halved_down, true);
  const auto lower = static_cast<float>(down.share);
  const auto sample = [&](uint32_t x) {
    const auto code = [&](uint32_t line) {
      return static_cast<float>(code_at(plane, uint64_t{line} * width + x, chroma_.bits));
    };
    return (code(down.first) * (1 - lower) + code(down.second) * lower - middle) / range;
  };
  for (uint32_t x = 0; x < row.size(); ++x) {
    const Neighbours across = chroma_around(x, width, chroma_.halved_across, chroma_.centred);
    row[x] = sample(across.first);
    const auto right = static_cast<float>(across.share);
    if (right > 0) row[x] += (sample(across.second) - row[x]) * right;
  }
}

absl::StatusOr<Image> Y4mFrames::image(std::span<const std::byte> planes) const {
  ASSIGN_OR_RETURN(Image image, image_to_overwrite(width_, height_, ImageFormat::kRgba32f));
  if (pixel_aspect_ != 1) set_pixel_aspect(pixel_aspect_, image);
  image.frame_rate = rate_;
  image.notes.insert(image.notes.end(), notes_.begin(), notes_.end());
  decoder_.describe(chroma_.bits, image);
  const size_t bytes = chroma_.bits == 8 ? 1 : 2;
  const uint64_t luma = uint64_t{width_} * height_ * bytes;
  const uint64_t chroma = chroma_.none ? 0 : uint64_t{chroma_width()} * chroma_height() * bytes;
  const auto scale = static_cast<float>(1 << (chroma_.bits - 8));
  const float black = full_ ? 0 : 16 * scale, white = full_ ? 256 * scale - 1 : 235 * scale;
  std::vector<float> cb(width_), cr(width_);
  std::vector<uint16_t> codes(size_t{4} * width_, 65535);
  for (uint32_t y = 0; y < height_; ++y) {
    chroma_row(planes.subspan(luma, chroma), y, cb);
    chroma_row(planes.subspan(luma + chroma, chroma), y, cr);
    for (uint32_t x = 0; x < width_; ++x) {
      const auto code = static_cast<float>(code_at(planes, uint64_t{y} * width_ + x, chroma_.bits));
      const float grey = (code - black) / (white - black);
      const float red = grey + matrix_.cr * cr[x], blue = grey + matrix_.cb * cb[x];
      codes[4 * size_t{x}] = code_of_signal(red);
      codes[4 * size_t{x} + 1] =
          code_of_signal((grey - matrix_.red * red - matrix_.blue * blue) / matrix_.green);
      codes[4 * size_t{x} + 2] = code_of_signal(blue);
    }
    decoder_.decode(codes, reinterpret_cast<float*>(image.pixels.data() + y * image.row_bytes()));
  }
  return image;
}

}  // namespace candela
