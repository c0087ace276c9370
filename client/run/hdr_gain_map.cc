#include "client/run/hdr_gain_map.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <vector>

#include "client/image/color.h"
#include "client/image/power.h"
#include "client/image/read/signal.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

using Rgb = std::array<double, 3>;

// Without it, a component that is 0 in one picture would have no gain that a code can hold.
constexpr double kOffset = 1.0 / 64;
constexpr double kLeastRange = 1.0 / 64;  // of a channel's logarithms, and of the headroom

constexpr double kSdrGreyNits = 9.999933;  // by ACES 2.0, of a grey of 0.18 in SDR

// Light 1 of the base, in nit of the HDR picture.
double white_nits(v1::ToneCurve curve, double peak_nits) {
  if (curve != v1::TONE_CURVE_ACES_2) return kReferenceWhiteNits;
  const Aces2Grey* const grey = std::ranges::find(kAces2Greys, peak_nits, &Aces2Grey::peak_nits);
  CHECK(grey != std::end(kAces2Greys));
  return 100.0 * grey->nits / kSdrGreyNits;
}

// From P3-D65 to Rec.709, 0 or more.
Rgb in_rec709(const float* p3) {
  constexpr double kMatrix[] = {1.2249401762805598,  -0.2249401762805597, 0.0,
                                -0.0420569547096881, 1.0420569547096881,  0.0,
                                -0.0196375545903344, -0.0786360455506318, 1.0982736001409663};
  Rgb out{};
  for (size_t i = 0; i < 9; ++i) out[i / 3] += kMatrix[i] * p3[i % 3];
  for (double& v : out) v = std::max(v, 0.0);
  return out;
}

// Linear light of the codes of sRGB.
std::array<double, 256> light_of_codes() {
  std::array<double, 256> light{};
  for (size_t i = 0; i < light.size(); ++i)
    light[i] = to_linear(ColorCurve::kSrgb, static_cast<double>(i) / 255);
  return light;
}

// The light of a row of the HDR picture, 1 at reference white.
class HdrRows {
 public:
  explicit HdrRows(const Image& hdr)
      : hdr_(hdr),
        decoder_({.transfer = SignalTransfer::kPq}, {}),
        codes_(size_t{4} * hdr.width),
        light_(codes_.size()) {}

  const std::vector<float>& row(uint32_t y) {
    std::memcpy(codes_.data(), hdr_.pixels.data() + y * hdr_.row_bytes(), hdr_.row_bytes());
    for (size_t i = 3; i < codes_.size(); i += 4) codes_[i] = 65535;  // a JPEG has no alpha
    decoder_.decode(codes_, light_.data());
    return light_;
  }

 private:
  const Image& hdr_;
  SignalDecoder decoder_;
  std::vector<uint16_t> codes_;
  std::vector<float> light_;
};

}  // namespace

v1::Settings hdr_settings(v1::Settings sdr, v1::ToneCurve curve, double peak_nits) {
  sdr.set_curve(curve);
  sdr.set_transfer(v1::TRANSFER_PQ);
  sdr.set_display_primaries(v1::PRIMARIES_P3_D65);
  sdr.set_peak_nits(peak_nits);
  sdr.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  if (curve != v1::TONE_CURVE_BT2390) {
    sdr.clear_source_peak_nits();
  } else if (sdr.has_source_peak_nits()) {
    sdr.set_source_peak_nits(std::max(sdr.source_peak_nits(), peak_nits));
  }
  sdr.clear_dither();
  sdr.clear_max_error_codes();  // the promise is about the SDR picture
  return sdr;
}

absl::StatusOr<GainMapCodes> gain_map_between(const Image& sdr, const Image& hdr, v1::ToneCurve curve,
                                              double peak_nits) {
  CHECK(sdr.format == ImageFormat::kRgba8 && hdr.format == ImageFormat::kRgba16);
  CHECK(sdr.width == hdr.width && sdr.height == hdr.height);
  const std::array<double, 256> sdr_light = light_of_codes();
  const double scale = kReferenceWhiteNits / white_nits(curve, peak_nits);
  const size_t pixels = size_t{sdr.width} * sdr.height;
  ASSIGN_OR_RETURN(Image gains, image_to_overwrite(sdr.width, sdr.height, ImageFormat::kRgba32f));
  auto* const gain = reinterpret_cast<float*>(gains.pixels.data());  // log2, of R, G, B and one more
  const auto* const code = reinterpret_cast<const uint8_t*>(sdr.pixels.data());
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  std::array<float, 3> least{kInfinity, kInfinity, kInfinity}, most{-kInfinity, -kInfinity, -kInfinity};
  double brightest = 0;
  HdrRows rows(hdr);
  for (uint32_t y = 0; y < sdr.height; ++y) {
    const std::vector<float>& light = rows.row(y);
    for (uint32_t x = 0; x < sdr.width; ++x) {
      const Rgb h = in_rec709(&light[size_t{4} * x]);
      const size_t at = 4 * (size_t{y} * sdr.width + x);
      for (size_t c = 0; c < 3; ++c) {
        brightest = std::max(brightest, h[c] * scale);
        const double ratio = (h[c] * scale + kOffset) / (sdr_light[code[at + c]] + kOffset);
        gain[at + c] = static_cast<float>(log2_of(ratio));
        least[c] = std::min(least[c], gain[at + c]);
        most[c] = std::max(most[c], gain[at + c]);
      }
    }
  }
  GainMapCodes map;
  map.metadata.one_channel = false;
  for (size_t c = 0; c < 3; ++c) {
    map.metadata.min_log2[c] = least[c];
    map.metadata.max_log2[c] = std::max<double>(most[c], least[c] + kLeastRange);
    map.metadata.offset_sdr[c] = map.metadata.offset_hdr[c] = kOffset;
  }
  map.metadata.headroom_hdr_log2 = std::max(kLeastRange, log2_of(std::max(brightest, 1.0)));
  map.codes.reserve(3 * pixels);
  for (size_t i = 0; i < 4 * pixels; ++i) {
    if (i % 4 == 3) continue;
    const double from = map.metadata.min_log2[i % 4], range = map.metadata.max_log2[i % 4] - from;
    map.codes.push_back(static_cast<uint8_t>((gain[i] - from) / range * 255 + 0.5));
  }
  return map;
}

}  // namespace candela
