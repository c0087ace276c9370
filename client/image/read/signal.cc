#include "client/image/read/signal.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/number_words.h"
#include "client/image/color.h"
#include "client/image/power.h"
#include "client/image/read/readers.h"

namespace candela {
namespace {

constexpr double kLog10Of2 = 0.3010299956639812;
constexpr int kCodes = 65536;
constexpr std::array<float, 8> kNone{};

// Nit of a PQ signal. Source: SMPTE ST 2084.
double pq_nits(double signal) {
  constexpr double kM1 = 2610.0 / 16384, kM2 = 2523.0 / 32;
  constexpr double kC1 = 3424.0 / 4096, kC2 = 2413.0 / 128, kC3 = 2392.0 / 128;
  const double p = power(signal, 1.0 / kM2);
  return 10000.0 * power(std::max(p - kC1, 0.0) / (kC2 - kC3 * p), 1.0 / kM1);
}

// Scene light, 0 .. 1, of an HLG signal. Source: ITU-R BT.2100.
double hlg_scene(double signal) {
  constexpr double kA = 0.17883277, kB = 0.28466892, kC = 0.55991073;
  return signal <= 0.5 ? signal * signal / 3.0 : (exponential((signal - kC) / kA) + kB) / 12.0;
}

// Light of a value: of 0 .. 1 of PQ and of HLG, of which it is scene light; of any of the other transfers.
double light_of(const Signal& signal, double v) {
  switch (signal.transfer) {
    case SignalTransfer::kLinear:
      return v;
    case SignalTransfer::kSrgb:
      return to_linear(ColorCurve::kSrgb, v);
    case SignalTransfer::kGamma:
      return std::copysign(power(std::abs(v), signal.gamma), v);
    case SignalTransfer::kPq:
      return pq_nits(v) / kReferenceWhiteNits;
    case SignalTransfer::kHlg:
      return hlg_scene(v);
  }
  return v;
}

bool is_display_light(SignalTransfer transfer) {
  return transfer == SignalTransfer::kPq || transfer == SignalTransfer::kHlg;
}

// The luminance of each primary, for white 1: SMPTE RP 177. A primary may have none.
std::array<double, 3> luminance_of(const std::array<float, 8>& xy) {
  const auto xyz = [&xy](int i) {
    const double x = xy[2 * i], y = xy[2 * i + 1];
    return std::array<double, 3>{x, y, 1.0 - x - y};
  };
  const std::array<double, 3> r = xyz(0), g = xyz(1), b = xyz(2), w = xyz(3);
  const auto determinant = [](const auto& p, const auto& q, const auto& s) {
    return p[0] * (q[1] * s[2] - q[2] * s[1]) - q[0] * (p[1] * s[2] - p[2] * s[1]) +
           s[0] * (p[1] * q[2] - p[2] * q[1]);
  };
  const double all = determinant(r, g, b) * w[1];
  return {r[1] * determinant(w, g, b) / all, g[1] * determinant(r, w, b) / all,
          b[1] * determinant(r, g, w) / all};
}

void set_rec2020(Signal& signal) { (void)set_code_points("", 9, 2, signal); }

void note_display_light(const Signal& signal, double hlg_peak, Image& image) {
  if (!is_display_light(signal.transfer)) return;
  constexpr double kUsualPeak = 1000;  // nit, of a PQ picture that does not say it
  image.light = PictureLight::kHdr;
  image.peak = (signal.transfer == SignalTransfer::kHlg ? hlg_peak : kUsualPeak) / kReferenceWhiteNits;
  image.notes.push_back(absl::StrFormat(
      "%s: 1 is reference white, 203 nit; exposure is 0 EV and there is no bloom unless they are given",
      name(signal)));
}

}  // namespace

std::string name(const Signal& signal) {
  switch (signal.transfer) {
    case SignalTransfer::kLinear:
      return "linear";
    case SignalTransfer::kSrgb:
      return "sRGB";
    case SignalTransfer::kGamma:
      return absl::StrCat("gamma ", in_digits(signal.gamma, 3));
    case SignalTransfer::kPq:
      return "PQ";
    case SignalTransfer::kHlg:
      return "HLG";
  }
  return "?";
}

absl::Status set_code_points(const std::string& path, int primaries, int transfer, Signal& signal) {
  const auto refused = [&](const char* what, int code, const char* known, const char* option) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its %s is %s %d of H.273; Candela reads %s; name another with %s", path,
                        signal.source, what, code, known, option));
  };
  switch (transfer) {
    case 1:
    case 13:
      signal.transfer = SignalTransfer::kSrgb;
      break;
    case 4:
      signal.transfer = SignalTransfer::kGamma;
      signal.gamma = 2.2;
      break;
    case 8:
      signal.transfer = SignalTransfer::kLinear;
      break;
    case 16:
      signal.transfer = SignalTransfer::kPq;
      break;
    case 18:
      signal.transfer = SignalTransfer::kHlg;
      break;
    case 2:
      break;
    default:
      return refused("transfer", transfer, "1, 4, 8, 13, 16 and 18", "--input-transfer");
  }
  const auto named = [&](const char* word) {
    for (const NamedPrimaries& one : named_primaries()) {
      if (one.name == std::string(word)) signal.xy = one.xy;
    }
    return absl::OkStatus();
  };
  if (primaries == 1) return named("Rec.709");
  if (primaries == 9) return named("Rec.2020");
  if (primaries == 12) return named("P3-D65");
  if (primaries == 2) return absl::OkStatus();
  return refused("primaries", primaries, "1, 9 and 12", "--primaries");
}

bool set_by_profile_name(const std::string& profile, Signal& signal) {
  const std::string small = absl::AsciiStrToLower(profile);
  const auto has = [&small](const char* word) { return absl::StrContains(small, word); };
  const bool p3 = has("p3"), rec2020 = has("2020") || has("2100"), pq = has("pq"), hlg = has("hlg");
  if (!p3 && !rec2020 && !pq && !hlg && !has("srgb")) return false;
  const int primaries = p3 ? 12 : rec2020 || pq || hlg ? 9 : 1;
  return set_code_points("", primaries, pq ? 16 : hlg ? 18 : 13, signal).ok();
}

void take_profile(const std::string& source, const std::string& profile, Signal& signal,
                  std::vector<std::string>& notes) {
  if (set_by_profile_name(profile, signal)) {
    signal.source = source;
    return;
  }
  notes.push_back(absl::StrFormat("the ICC profile \"%s\" is none that Candela knows: taken as sRGB",
                                  printable(profile)));
}

HlgDisplay::HlgDisplay(const std::array<float, 8>& xy, double peak)
    : luminance_(luminance_of(xy)),
      peak_(peak / kReferenceWhiteNits),
      exponent_(0.2 + 0.42 * kLog10Of2 * log2_of(peak / 1000.0)) {}

double HlgDisplay::scale(const std::array<double, 3>& scene) const {
  double y = 0;
  for (size_t k = 0; k < 3; ++k) y += std::isnan(scene[k]) ? 0.0 : luminance_[k] * scene[k];
  return y > 0 ? peak_ * power(y, exponent_) : 0.0;
}

SignalDecoder::SignalDecoder(Signal signal, const PictureChoice& choice)
    : signal_(std::move(signal)),
      own_values_(choice.own_values),
      coded_(choice.keeps_signal),
      hlg_peak_(choice.hlg_peak) {
  if (choice.transfer) {
    signal_.transfer = *choice.transfer;
    signal_.gamma = 2.2;
    assumes_primaries_ = is_display_light(signal_.transfer) && signal_.xy == kNone;
    if (assumes_primaries_) set_rec2020(signal_);
  }
  light_.resize(kCodes);
  for (int i = 0; i < kCodes; ++i) {
    const double v = static_cast<double>(i) / (kCodes - 1);
    light_[i] = static_cast<float>(coded_ ? v : light_of(signal_, v));
  }
  if (coded_) signal_.transfer = SignalTransfer::kLinear;
  if (signal_.transfer == SignalTransfer::kHlg) {
    hlg_.emplace(choice.primaries.value_or(signal_.xy == kNone ? kRec709.xy : signal_.xy), choice.hlg_peak);
  }
}

void SignalDecoder::decode(std::span<const uint16_t> codes, float* light) const {
  for (size_t i = 0; i < codes.size(); i += 4, light += 4) {
    double scale = codes[i + 3] / 65535.0;
    if (hlg_) scale *= hlg_->scale({light_[codes[i]], light_[codes[i + 1]], light_[codes[i + 2]]});
    for (size_t k = 0; k < 3; ++k) light[k] = static_cast<float>(scale * light_[codes[i + k]]);
    light[3] = static_cast<float>(codes[i + 3] / 65535.0);
  }
}

void SignalDecoder::describe(int bits, Image& image) const {
  if (!own_values_ && signal_.xy != kNone) set_chromaticities(signal_.xy, image);
  if (assumes_primaries_) image.names_primaries = false;
  image.signal = absl::StrFormat("%d bits, %s%s", bits, name(signal_),
                                 signal_.source.empty() ? ", assumed" : ", from " + signal_.source);
  if (!coded_) image.light = PictureLight::kSdr;
  note_display_light(signal_, hlg_peak_, image);
}

bool decodes_values(const PictureChoice& choice) {
  return choice.transfer && *choice.transfer != SignalTransfer::kLinear && !choice.keeps_signal;
}

void decode_values(const PictureChoice& choice, Image& image) {
  if (!decodes_values(choice)) return;
  Signal signal{.transfer = *choice.transfer};
  const bool display = is_display_light(signal.transfer);
  if (display && !image.names_primaries && !choice.own_values) {
    set_rec2020(signal);
    set_chromaticities(signal.xy, image);
    image.names_primaries = false;
  }
  std::optional<HlgDisplay> hlg;
  if (signal.transfer == SignalTransfer::kHlg) {
    hlg.emplace(choice.primaries.value_or(image.chromaticities.value_or(kRec709.xy)), choice.hlg_peak);
  }
  bool cut = false;
  std::byte* const end = image.pixels.data() + image.bytes();
  for (std::byte* at = image.pixels.data(); at != end; at += 4 * sizeof(float)) {
    std::array<float, 4> pixel;
    std::memcpy(pixel.data(), at, sizeof pixel);
    const double alpha = pixel[3] > 0 && std::isfinite(pixel[3]) ? pixel[3] : 1.0;
    std::array<double, 3> light;
    for (size_t c = 0; c < 3; ++c) {
      double v = pixel[c] / alpha;
      if (display && (v < 0 || v > 1)) {
        cut = true;
        v = v < 0 ? 0 : 1;
      }
      light[c] = light_of(signal, v);
    }
    const double scale = hlg ? alpha * hlg->scale(light) : alpha;
    for (size_t c = 0; c < 3; ++c) pixel[c] = static_cast<float>(scale * light[c]);
    std::memcpy(at, pixel.data(), sizeof pixel);
  }
  note_display_light(signal, choice.hlg_peak, image);
  if (cut) {
    image.notes.push_back(
        absl::StrFormat("%s: values below 0 or above 1 are no signal, and were cut", name(signal)));
  }
}

}  // namespace candela
