#include "client/image/read/signal.h"

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstring>
#include <iterator>
#include <utility>

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
constexpr int kRec2020Code = 9;

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

// SMPTE ST 240, as H.273 gives it: signal = 4 light, and above 0.0228 1.1115 light^0.45 - 0.1115.
double smpte240_light(double v) { return v < 4 * 0.0228 ? v / 4 : power((v + 0.1115) / 1.1115, 1 / 0.45); }

// H.273: signal = 1 + log10(light) / decades. 0 is any light below the least.
double log_light(double v, double decades) {
  constexpr double kLnOf10 = 2.302585092994046;
  return v > 0 ? exponential(kLnOf10 * decades * (v - 1)) : 0;
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

void note_display_light(const Signal& signal, double hlg_peak, Image& image) {
  if (!is_display_light(signal.transfer)) return;
  constexpr double kUsualPeak = 1000;  // nit, of a PQ picture that does not say it
  const double peak = signal.transfer == SignalTransfer::kHlg ? hlg_peak
                      : signal.max_light_nits > 0             ? signal.max_light_nits
                                                              : kUsualPeak;
  image.light = PictureLight::kHdr;
  image.peak = std::max(peak / kReferenceWhiteNits, 1.0);
  image.notes.push_back(absl::StrFormat("%s: 1 is reference white, 203 nit, and the picture's peak %s nit",
                                        name(signal), in_digits(image.peak * kReferenceWhiteNits, 4)));
}

// The transfers of H.273 with one function: kGamma has the power.
struct CodedTransfer {
  int code;
  SignalTransfer transfer;
  double gamma = 0;
};
constexpr CodedTransfer kCodedTransfers[] = {
    {1, SignalTransfer::kSrgb},   {4, SignalTransfer::kGamma, 2.2}, {5, SignalTransfer::kGamma, 2.8},
    {6, SignalTransfer::kSrgb},   {7, SignalTransfer::kSmpte240},   {8, SignalTransfer::kLinear},
    {9, SignalTransfer::kLog100}, {10, SignalTransfer::kLog316},    {11, SignalTransfer::kSrgb},
    {12, SignalTransfer::kSrgb},  {13, SignalTransfer::kSrgb},      {14, SignalTransfer::kSrgb},
    {15, SignalTransfer::kSrgb},  {16, SignalTransfer::kPq},        {17, SignalTransfer::kCinema},
    {18, SignalTransfer::kHlg}};

// The primaries with this number; null if there are none. 7 is another number of 6.
const NamedPrimaries* coded_primaries(int code) {
  const auto known = named_primaries();
  const auto found = std::ranges::find(known, code == 7 ? 6 : code, &NamedPrimaries::code);
  return code == 0 || found == known.end() ? nullptr : &*found;
}

}  // namespace

double light_of(const Signal& signal, double v) {
  switch (signal.transfer) {
    case SignalTransfer::kLinear:
    case SignalTransfer::kProfile:
      return v;
    case SignalTransfer::kSrgb:
      return to_linear(ColorCurve::kSrgb, v);
    case SignalTransfer::kGamma:
      return std::copysign(power(std::abs(v), signal.gamma), v);
    case SignalTransfer::kPq:
      return pq_nits(v) / kReferenceWhiteNits;
    case SignalTransfer::kHlg:
      return hlg_scene(v);
    case SignalTransfer::kSmpte240:
      return smpte240_light(v);
    case SignalTransfer::kLog100:
      return log_light(v, 2);
    case SignalTransfer::kLog316:
      return log_light(v, 2.5);
    case SignalTransfer::kCinema:
      return 52.37 / 48 * std::copysign(power(std::abs(v), 2.6), v);
  }
  return v;
}

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
    case SignalTransfer::kSmpte240:
      return "SMPTE ST 240";
    case SignalTransfer::kLog100:
      return "logarithmic (100:1)";
    case SignalTransfer::kLog316:
      return "logarithmic (316:1)";
    case SignalTransfer::kCinema:
      return "SMPTE ST 428-1";
    case SignalTransfer::kProfile:
      return signal.table ? "the profile's table" : "the profile's curves";
  }
  return "?";
}

bool is_camera_transfer(int transfer) {
  constexpr int kSrgbCode = 13;
  const auto* const coded = std::ranges::find(kCodedTransfers, transfer, &CodedTransfer::code);
  return coded != std::end(kCodedTransfers) && coded->transfer == SignalTransfer::kSrgb &&
         transfer != kSrgbCode;
}

absl::Status set_code_points(const std::string& path, const char* source, int primaries, int transfer,
                             const PictureChoice& choice, Signal& signal) {
  const auto* const coded = std::ranges::find(kCodedTransfers, transfer, &CodedTransfer::code);
  const bool has_transfer = coded != std::end(kCodedTransfers);
  const NamedPrimaries* const named = coded_primaries(primaries);
  const bool bad_transfer =
      !has_transfer && transfer != kUnspecifiedCode && !choice.transfer && !choice.keeps_signal;
  const bool bad_primaries = named == nullptr && primaries != kUnspecifiedCode && !choice.own_values;
  if (bad_transfer || bad_primaries) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": its ", source, " has ", bad_transfer ? absl::StrCat("transfer ", transfer) : "",
        bad_transfer && bad_primaries ? " and " : "",
        bad_primaries ? absl::StrCat("primaries ", primaries) : "", ", which H.273 gives no meaning; name ",
        bad_transfer ? "the transfer with --input-transfer" : "",
        bad_transfer && bad_primaries ? " and " : "", bad_primaries ? "the primaries with --primaries" : ""));
  }
  if (signal.table && transfer == kUnspecifiedCode) return absl::OkStatus();  // it counts as a whole
  signal.source = source;
  if (signal.table) signal.xy = kNone;
  if (has_transfer) {
    signal.transfer = coded->transfer;
    signal.gamma = coded->gamma;
    signal.curve = nullptr;
    signal.table = nullptr;
  }
  if (named != nullptr) signal.xy = named->xy;
  return absl::OkStatus();
}

void set_adobe_rgb(Signal& signal) {
  constexpr double kGamma = 563 / 256.0;
  signal.transfer = SignalTransfer::kGamma;
  signal.gamma = kGamma;
  signal.xy = kAdobeRgb.xy;
  signal.source = "Exif";
}

double max_light(double of_pixels, double of_display) {
  constexpr double kPqPeak = 10000;
  const auto says = [](double nits) { return nits > 0 && nits < kPqPeak; };
  return says(of_pixels) ? of_pixels : says(of_display) ? of_display : 0;
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

namespace {

// A strange profile may lead beyond floats, or to no number, which is black then.
float finite_light(double light) {
  return std::isnan(light) ? 0 : static_cast<float>(std::clamp<double>(light, -FLT_MAX, FLT_MAX));
}

}  // namespace

SignalDecoder::SignalDecoder(Signal signal, const PictureChoice& choice)
    : signal_(std::move(signal)),
      own_values_(choice.own_values),
      coded_(choice.keeps_signal),
      hlg_peak_(choice.hlg_peak) {
  drops_table_ = signal_.table && (choice.transfer || choice.own_values || coded_);
  if (drops_table_) {  // it is of the codes as they are, and gives light in Rec.709
    signal_.table = nullptr;
    signal_.transfer = SignalTransfer::kSrgb;
    signal_.xy = kNone;
    signal_.source = "";
  }
  if (choice.transfer) {
    signal_.transfer = *choice.transfer;
    signal_.gamma = choice.gamma;
    signal_.curve = nullptr;
    assumes_primaries_ = is_display_light(signal_.transfer) && signal_.xy == kNone;
    if (assumes_primaries_) signal_.xy = coded_primaries(kRec2020Code)->xy;
  }
  if (coded_) signal_.transfer = SignalTransfer::kLinear;
  if (signal_.table) return;
  const size_t tables = signal_.curve && !coded_ ? 3 : 1;
  channel_step_ = tables == 3 ? kCodes : 0;
  light_.resize(tables * kCodes);
  for (size_t i = 0; i < light_.size(); ++i) {
    const double v = static_cast<double>(i % kCodes) / (kCodes - 1);
    light_[i] = finite_light(tables == 3 ? signal_.curve(i / kCodes, v) : light_of(signal_, v));
  }
  if (signal_.transfer == SignalTransfer::kHlg) {
    hlg_.emplace(choice.primaries.value_or(signal_.xy == kNone ? kRec709.xy : signal_.xy), choice.hlg_peak);
  }
}

void SignalDecoder::decode(std::span<const uint16_t> codes, float* light) const {
  if (signal_.table) {
    signal_.table(codes.data(), codes.size() / 4, light);
    for (size_t i = 0; i < codes.size(); i += 4, light += 4) {
      light[3] = signal_.inks ? 1 : static_cast<float>(codes[i + 3] / 65535.0);
      for (size_t k = 0; k < 3; ++k) light[k] = finite_light(light[k]) * light[3];
    }
    return;
  }
  if (!signal_.inks) return decode_rgb(codes, light);
  for (size_t i = 0; i < codes.size(); i += 4, light += 4) {
    const auto left = [&](size_t k) { return uint32_t{65535} - codes[i + k]; };
    std::array<uint16_t, 4> rgb{0, 0, 0, 65535};
    for (size_t k = 0; k < 3; ++k) rgb[k] = static_cast<uint16_t>((left(k) * left(3) + 32767) / 65535);
    decode_rgb(rgb, light);
  }
}

void SignalDecoder::decode_rgb(std::span<const uint16_t> codes, float* light) const {
  const float* const tables[] = {light_.data(), light_.data() + channel_step_,
                                 light_.data() + 2 * channel_step_};
  for (size_t i = 0; i < codes.size(); i += 4, light += 4) {
    const double alpha = codes[i + 3] / 65535.0;
    std::array<double, 3> of{};
    for (size_t k = 0; k < 3; ++k) of[k] = tables[k][codes[i + k]];
    const double scale = hlg_ ? alpha * hlg_->scale(of) : alpha;
    for (size_t k = 0; k < 3; ++k) light[k] = static_cast<float>(scale * of[k]);
    light[3] = static_cast<float>(alpha);
  }
}

void SignalDecoder::describe(int bits, Image& image) const {
  if (!own_values_ && signal_.xy != kNone) set_chromaticities(signal_.xy, image);
  if (assumes_primaries_) image.names_primaries = false;
  image.signal = absl::StrFormat("%d bits, %s%s", bits, name(signal_),
                                 signal_.source.empty() ? ", assumed" : ", from " + signal_.source);
  if (!coded_) image.light = PictureLight::kSdr;
  if (drops_table_ && !coded_) {
    image.notes.emplace_back(
        "its ICC profile is not used, because --input-transfer or --primaries says what the codes are");
  }
  if (signal_.inks && !signal_.table) {
    image.notes.emplace_back(
        "CMYK without a profile that is used: its inks are taken as ideal, R = (1 - C) (1 - K)");
  }
  note_display_light(signal_, hlg_peak_, image);
}

bool decodes_values(const PictureChoice& choice) {
  return choice.transfer && *choice.transfer != SignalTransfer::kLinear && !choice.keeps_signal;
}

void decode_values(const PictureChoice& choice, Image& image) {
  if (!decodes_values(choice)) return;
  Signal signal{.transfer = *choice.transfer, .gamma = choice.gamma};
  const bool display = is_display_light(signal.transfer);
  if (display && !image.names_primaries && !choice.own_values) {
    signal.xy = coded_primaries(kRec2020Code)->xy;
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
