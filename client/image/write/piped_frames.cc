#include "client/image/write/piped_frames.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "client/image/color.h"
#include "client/image/write/writers.h"
#include "server/encode/color_words.h"

namespace candela {
namespace {

constexpr char kFrame[] = "FRAME\n";

const OutputEncoding kFilm{.name = "y4m",
                           .extensions = {"y4m"},
                           .formats = {ImageFormat::kRgba16},
                           .alpha = v1::ALPHA_UNSPECIFIED,
                           .server = v1::ENCODING_RAW,
                           .lossy = false,
                           .hdr = true,
                           .write = nullptr};
const OutputEncoding kPams{.name = "PAM",
                           .extensions = {"PAM"},
                           .formats = {ImageFormat::kRgba8, ImageFormat::kRgba16},
                           .alpha = v1::ALPHA_STRAIGHT,
                           .server = v1::ENCODING_RAW,
                           .lossy = false,
                           .hdr = false,
                           .write = nullptr};

struct Signal {
  float r, g, b;
};

// The codes of a sum of `weight` pixels' signals, for samples of 8 bits or more.
template <typename Sample>
class Coder {
 public:
  Coder(const PipeFormat& format, const LumaMatrix& matrix, int weight)
      : matrix_(matrix),
        scale_(static_cast<float>(1 << (format.bits - 8))),
        one_(scale_ / (65535.0f * static_cast<float>(weight))) {}

  Sample luma(Signal c) const { return rounded(scale_ * 16 + one_ * 219 * y(c)); }
  Sample cb(Signal c) const { return rounded(scale_ * 128 + one_ * (224 / matrix_.cb) * (c.b - y(c))); }
  Sample cr(Signal c) const { return rounded(scale_ * 128 + one_ * (224 / matrix_.cr) * (c.r - y(c))); }

 private:
  float y(Signal c) const { return matrix_.red * c.r + matrix_.green * c.g + matrix_.blue * c.b; }
  static Sample rounded(float code) { return static_cast<Sample>(static_cast<int>(code + 0.5f)); }

  LumaMatrix matrix_;
  float scale_, one_;
};

Signal pixel_at(const uint16_t* row, size_t x) {
  return {static_cast<float>(row[4 * x]), static_cast<float>(row[4 * x + 1]),
          static_cast<float>(row[4 * x + 2])};
}

// The codes of a pixel and of those beside it, weighted 1 2 1.
Signal three_at(const uint16_t* row, size_t x, size_t width) {
  const Signal left = pixel_at(row, x == 0 ? 0 : x - 1), at = pixel_at(row, x),
               right = pixel_at(row, std::min(x + 1, width - 1));
  return {left.r + 2 * at.r + right.r, left.g + 2 * at.g + right.g, left.b + 2 * at.b + right.b};
}

template <typename Sample>
void make_planes(const PipeFormat& format, const Image& picture, std::byte* to) {
  const bool halved = format.kind == PipeKind::kY4m420;
  const size_t width = picture.width, height = picture.height;
  const auto row_at = [&picture](size_t y) {
    return reinterpret_cast<const uint16_t*>(picture.pixels.data() + y * picture.row_bytes());
  };
  auto* sample = reinterpret_cast<Sample*>(to);
  const LumaMatrix matrix = matrix_of(format, picture.height);
  const Coder<Sample> pixels(format, matrix, 1), blocks(format, matrix, 8);
  for (size_t y = 0; y < height; ++y) {
    for (size_t x = 0; x < width; ++x) *sample++ = pixels.luma(pixel_at(row_at(y), x));
  }
  const size_t step = halved ? 2 : 1;
  Sample* cb = sample;
  Sample* cr = cb + ((width + step - 1) / step) * ((height + step - 1) / step);
  for (size_t y = 0; y < height; y += step) {
    const uint16_t* row = row_at(y);
    const uint16_t* below = row_at(std::min(y + 1, height - 1));
    for (size_t x = 0; x < width; x += step) {
      if (!halved) {
        *cb++ = pixels.cb(pixel_at(row, x));
        *cr++ = pixels.cr(pixel_at(row, x));
        continue;
      }
      const Signal a = three_at(row, x, width), b = three_at(below, x, width);
      const Signal sum{a.r + b.r, a.g + b.g, a.b + b.b};
      *cb++ = blocks.cb(sum);
      *cr++ = blocks.cr(sum);
    }
  }
}

void make_pam(const Image& picture, std::vector<std::byte>& bytes) {
  const bool wide = picture.format == ImageFormat::kRgba16;
  const size_t depth = picture.has_alpha ? 4 : 3, sample = wide ? 2 : 1;
  const std::string header =
      absl::StrFormat("P7\nWIDTH %d\nHEIGHT %d\nDEPTH %d\nMAXVAL %d\nTUPLTYPE RGB%s\nENDHDR\n", picture.width,
                      picture.height, depth, wide ? 65535 : 255, picture.has_alpha ? "_ALPHA" : "");
  const size_t pixels = size_t{picture.width} * picture.height;
  bytes.resize(header.size() + pixels * depth * sample);
  std::memcpy(bytes.data(), header.data(), header.size());
  std::byte* to = bytes.data() + header.size();
  const std::byte* from = picture.pixels.data();
  for (size_t i = 0; i < pixels; ++i, from += 4 * sample, to += depth * sample) {
    std::memcpy(to, from, depth * sample);
    for (size_t c = 0; wide && c < depth; ++c) std::swap(to[2 * c], to[2 * c + 1]);  // big endian
  }
}

}  // namespace

const OutputEncoding& piped_encoding(PipeKind kind) { return kind == PipeKind::kPam ? kPams : kFilm; }

PipeFormat pipe_format(PipeKind kind, int bits, EncodedTransfer transfer, const HdrDisplay& hdr) {
  const bool hdr_signal = is_hdr(transfer);
  PipeFormat format{kind, bits != 0 ? bits : hdr_signal ? 10 : 8};
  if (hdr_signal) format.matrix = hdr.p3 ? kRec709Luma : kRec2020Luma;
  return format;
}

LumaMatrix matrix_of(const PipeFormat& format, uint32_t height) {
  return format.matrix.value_or(height < kHdLines ? kRec601Luma : kRec709Luma);
}

std::string film_header(const PipeFormat& format, uint32_t width, uint32_t height, double pixel_aspect,
                        FrameRate rate) {
  if (format.kind == PipeKind::kPam) return "";
  const AspectRatio aspect = aspect_ratio(pixel_aspect);
  const bool halved = format.kind == PipeKind::kY4m420, wide = format.bits > 8;
  const char* chroma = halved ? (wide ? "C420p10 XYSCSS=420P10" : "C420mpeg2 XYSCSS=420MPEG2")
                              : (wide ? "C444p10 XYSCSS=444P10" : "C444 XYSCSS=444");
  return absl::StrFormat("YUV4MPEG2 W%d H%d F%d:%d Ip A%d:%d %s XCOLORRANGE=LIMITED\n", width, height,
                         rate.frames, rate.seconds, aspect.width, aspect.height, chroma);
}

void make_piped_frame(const PipeFormat& format, const Image& picture, std::vector<std::byte>& bytes) {
  if (format.kind == PipeKind::kPam) return make_pam(picture, bytes);
  const size_t step = format.kind == PipeKind::kY4m420 ? 2 : 1, sample = format.bits > 8 ? 2 : 1;
  const size_t luma = size_t{picture.width} * picture.height,
               chroma = ((picture.width + step - 1) / step) * ((picture.height + step - 1) / step);
  constexpr size_t kHead = sizeof kFrame - 1;
  static_assert(kHead % 2 == 0, "the samples of 10 bits are aligned");
  static_assert(std::endian::native == std::endian::little, "y4m is little endian");
  bytes.resize(kHead + (luma + 2 * chroma) * sample);
  std::memcpy(bytes.data(), kFrame, kHead);
  if (sample == 1) {
    make_planes<uint8_t>(format, picture, bytes.data() + kHead);
  } else {
    make_planes<uint16_t>(format, picture, bytes.data() + kHead);
  }
}

}  // namespace candela
