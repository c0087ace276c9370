#include "client/cli/commands/report/aces.h"

#include <lcms2.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kReference[] = "aces-1";
constexpr const char* kFits[] = {"aces-narkowicz", "aces-hill"};
constexpr double kFullScale = 65535;

using Codes = std::array<uint16_t, 4>;

Codes pixel(const RenderResult& result, size_t i) {
  Codes codes;
  std::memcpy(codes.data(), result.data.get() + i * sizeof codes, sizeof codes);
  return codes;
}

// IEC 61966-2-1.
double srgb_to_linear(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }

// The linear light of every 16-bit code.
const std::vector<double>& light_of_codes() {
  static const std::vector<double> table = [] {
    std::vector<double> light(65536);
    for (size_t i = 0; i < light.size(); ++i) light[i] = srgb_to_linear(static_cast<double>(i) / kFullScale);
    return light;
  }();
  return table;
}

cmsCIELab lab_of(const Codes& codes) {
  const std::vector<double>& light = light_of_codes();
  const double r = light[codes[0]], g = light[codes[1]], b = light[codes[2]];
  // The sRGB primaries. Their sum is the white point.
  const cmsCIEXYZ xyz = {0.4123908 * r + 0.3575843 * g + 0.1804808 * b,
                         0.2126390 * r + 0.7151687 * g + 0.0721923 * b,
                         0.0193308 * r + 0.1191948 * g + 0.9505322 * b};
  static constexpr cmsCIEXYZ kWhite = {0.9504559, 1.0, 1.0890578};
  cmsCIELab lab;
  cmsXYZ2Lab(&kWhite, &lab, &xyz);
  return lab;
}

double codes_apart(const Codes& a, const Codes& b) {
  int most = 0;
  for (size_t k = 0; k < 3; ++k) most = std::max(most, std::abs(int{a[k]} - int{b[k]}));
  return most * 255 / kFullScale;
}

// The order of `values` changes.
Json summary(std::vector<double>& values) {
  const auto p95 = values.begin() + static_cast<ptrdiff_t>(0.95 * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), p95, values.end());
  return {{"max", *std::max_element(values.begin(), values.end())},
          {"p95", *p95},
          {"mean", std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size())}};
}

void add_distances(const RenderResult& whole, const RenderResult& approximation, Json& row) {
  const size_t pixels = whole.bytes / sizeof(Codes);
  std::vector<double> codes(pixels), delta_e(pixels);
  for (size_t i = 0; i < pixels; ++i) {
    const Codes a = pixel(whole, i), b = pixel(approximation, i);
    codes[i] = codes_apart(a, b);
    const cmsCIELab lab_a = lab_of(a), lab_b = lab_of(b);
    delta_e[i] = codes[i] == 0 ? 0 : cmsCIE2000DeltaE(&lab_a, &lab_b, 1, 1, 1);
  }
  row["pixels"] = pixels;
  row["codes"] = summary(codes);
  row["delta_e"] = summary(delta_e);
}

// Renders one set of colours with every curve and tier.
class ColorSet {
 public:
  ColorSet(const ReportSession& session, std::string name, const Image& frame, bool metered)
      : session_(session), name_(std::move(name)), frame_(frame), metered_(metered) {}

  void add_rows(v1::ToneCurve whole_curve, Json& rows) const {
    const std::string best = session_.most_accurate_tier();
    const absl::StatusOr<RenderResult> whole = render(whole_curve, best);
    const auto add = [&](const std::string& word, v1::ToneCurve curve, const std::string& tier) {
      Json row = {{"curve", word}, {"tier", tier}, {"set", name_}};
      const absl::StatusOr<RenderResult> approximation = whole.ok() ? render(curve, tier) : whole.status();
      if (approximation.ok()) {
        add_distances(*whole, *approximation, row);
      } else {
        row["error"] = std::string(approximation.status().message());
      }
      rows.push_back(std::move(row));
    };
    for (const char* word : kFits) {
      if (const std::optional<v1::ToneCurve> curve = session_.curve(word)) add(word, *curve, best);
    }
    for (const std::string& tier : session_.tiers()) {
      if (tier != best) add(kReference, whole_curve, tier);
    }
  }

 private:
  absl::StatusOr<RenderResult> render(v1::ToneCurve curve, const std::string& tier) const {
    v1::Settings settings = ReportSession::settings(tier);
    settings.set_curve(curve);
    settings.mutable_bloom()->set_intensity(0);
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    if (!metered_) settings.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
    return session_.render(settings, frame_);
  }

  const ReportSession& session_;
  const std::string name_;
  const Image& frame_;
  const bool metered_;
};

}  // namespace

absl::StatusOr<Json> compare_aces(const ReportSession& session, const std::vector<ReportImage>& images) {
  Json comparison = {{"tier", session.most_accurate_tier()}, {"reference", kReference}};
  const std::optional<v1::ToneCurve> reference = session.curve(kReference);
  if (!reference) {
    comparison["missing"] = absl::StrFormat(
        "this server does not have curve %s, the whole ACES 1 transform, to compare the approximations with",
        kReference);
    return comparison;
  }
  session.show("ACES: charts");
  ASSIGN_OR_RETURN(const std::vector<Chart> charts, color_charts());
  Json rows = Json::array();
  for (const Chart& chart : charts)
    ColorSet(session, chart.name, chart.frame, false).add_rows(*reference, rows);
  for (const ReportImage& image : images) {
    session.show("ACES: " + image.name);
    ColorSet(session, image.name, image.image, true).add_rows(*reference, rows);
  }
  comparison["rows"] = std::move(rows);
  return comparison;
}

}  // namespace candela
