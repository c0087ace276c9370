#include "server/render/color/aces2.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <mutex>
#include <numbers>
#include <utility>

#include "server/base/check.h"
#include "server/render/color/portable_math.h"
#include "shaders/params.h"

namespace candela::aces2 {
namespace {

// Viewing conditions: 100 nit of adaptation, a background of 20 %, a dim surround.
constexpr double kAdaptation = 100.0, kBackground = 20.0, kSurroundC = 0.59;

}  // namespace

const double kGamma = kSurroundC * (1.48 + std::sqrt(kBackground / kReference));
const double kAdaptedLight = [] {
  const double k4 = std::pow(1.0 / (5.0 * kAdaptation + 1.0), 4.0);
  return (0.2 * k4 * 5.0 * kAdaptation + 0.1 * std::pow(1.0 - k4, 2.0) * std::cbrt(5.0 * kAdaptation)) /
         kReference;
}();

double library_power(double x, double y) { return std::pow(x, y); }

double respond(double light, Power power) {
  const double p = power(std::abs(light) * kAdaptedLight, 0.42);
  return std::copysign(400.0 * p / (27.13 + p), light);
}
double light_of(double response, Power power) {
  const double r = std::abs(response);
  return std::copysign(power(27.13 * r / (400.0 - r), 1.0 / 0.42) / kAdaptedLight, response);
}

double J_of_response(double A) { return 100.0 * std::pow(A, kGamma); }
double response_of(double J) { return std::pow(J / 100.0, 1.0 / kGamma); }
double J_of(double nits) { return J_of_response(respond(nits) / respond(kReference)); }

ToneScale::ToneScale(double peak_nits) : g(1.15), t_1(0.04), log_peak(std::log10(peak_nits / kReference)) {
  const double peak = peak_nits / kReference;
  r_hit = 128.0 + (896.0 - 128.0) * log_peak / 2.0;
  const double m_1 = 0.5 * (peak + std::sqrt(peak * (peak + 4.0 * t_1)));
  const double u = std::pow((r_hit / m_1) / (r_hit / m_1 + 1.0), g);
  const double m = m_1 / u;
  c_t = 10.013 / kReference * (1.0 + std::log2(peak) * 0.14);
  const double g_ip = 0.5 * (c_t + std::sqrt(c_t * (c_t + 4.0 * t_1)));
  const double power = std::pow(g_ip / m, 1.0 / g);
  const double w_2 = 0.18 / -(m_1 * power / (power - 1.0));
  s_2 = w_2 * m_1 * kReference;
  m_2 = m_1 / std::pow((r_hit / m_1) / (r_hit / m_1 + w_2), g);
}

double ToneScale::response(double A, Power power) const {
  const double white = respond(kReference, power);
  const double nits = light_of(white * A, power);
  const double f = m_2 * power(nits / (nits + s_2), g);
  return respond(std::max(0.0, f * f / (f + t_1)) * kReference, power) / white;
}

}  // namespace candela::aces2

namespace candela {
namespace {

using aces2::J_of;
using aces2::J_of_response;
using aces2::kGamma;
using aces2::kReference;
using aces2::light_of;
using aces2::respond;
using aces2::response_of;
using Imath::M33d;
using Imath::V3d;

// Imath multiplies row vectors from the left.

constexpr int kHues = 360;

constexpr double kSurroundN = 0.9;  // of a dim surround

// The primaries of CIECAM16's cones.
constexpr Chromaticities kCones{{0.8336, 0.1735, 2.3854, -1.4659, 0.087, -0.125, 0.333, 0.333}};

M33d diagonal(const V3d& v) { return {v.x, 0, 0, 0, v.y, 0, 0, 0, v.z}; }

M33d to_xyz(const Chromaticities& primaries) {
  const std::array<double, 9> m = matrix_to_xyz(primaries);
  return M33d(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]).transposed();
}

double radians(double degrees) { return degrees * std::numbers::pi / 180.0; }

// Corners of the unit cube in the order of their hues: red, yellow, green, cyan, blue, magenta.
constexpr int kCorners = 6;
V3d corner(int i) {
  const auto on = [i](int shift) { return (i + shift) % kCorners < 3 ? 1.0 : 0.0; };
  return {on(1), on(5), on(3)};
}

// Leaves x alone from `limit` on, and bends it towards 0 below.
double toe(double x, double limit, double k1_in, double k2_in) {
  if (x > limit) return x;
  const double k2 = std::max(k2_in, 0.001);
  const double k1 = std::hypot(k1_in, k2);
  const double k3 = (limit + k1) / (limit + k2);
  const double minus_b = k3 * x - k1;
  return 0.5 * (minus_b + std::sqrt(minus_b * minus_b + 4.0 * k2 * k3 * x));
}

double chroma_norm(double hue) {
  const double a = radians(hue);
  return 11.34072 * std::cos(a) + 16.46899 * std::cos(2 * a) + 7.88380 * std::cos(3 * a) +
         14.66441 * std::sin(a) - 6.37224 * std::sin(2 * a) + 9.19364 * std::sin(3 * a) + 77.12896;
}

constexpr double kSmooth = 0.12;  // of the cusp, as a share of its colourfulness
constexpr double kCuspGain = 1.0 + 0.27 * kSmooth;
constexpr double kMidBlend = 1.3, kGainBlend = 0.3, kGainPower = 2.0, kThreshold = 0.75;

double smooth_minimum(double a, double b, double scale) {
  const double width = kSmooth * scale;
  const double h = std::max(width - std::abs(a - b), 0.0) / width;
  return std::min(a, b) - h * h * h * width / 6.0;
}

// Colourfulness at which a line meets a hull J = max_J (M / max_M)^(1 / inverse_gamma), approximately.
double meets_hull(double axis_J, double slope, double inverse_gamma, double max_J, double max_M,
                  double reference_J) {
  const double shifted = reference_J * std::pow(axis_J / reference_J, inverse_gamma);
  return shifted / (max_J / max_M - slope);
}

}  // namespace

Aces2::Appearance::Appearance(const Chromaticities& primaries) {
  const M33d cones = to_xyz(kCones).inverse();
  const V3d white = V3d(1.0) * to_xyz(primaries) * cones;
  to_cone = to_xyz(primaries) * cones * diagonal(V3d(kReference) / white);
  from_cone = to_cone.inverse();
  const double scale = 43.0 * kSurroundN, white_response = (2.0 + 1.0 + 1.0 / 20.0) * respond(kReference);
  to_aab = M33d(2.0 / white_response, scale, scale / 9.0,                 //
                1.0 / white_response, scale * -12.0 / 11.0, scale / 9.0,  //
                1.0 / 20.0 / white_response, scale / 11.0, scale * -2.0 / 9.0);
  from_aab = to_aab.inverse();
}

V3d Aces2::Appearance::cone(const V3d& rgb) const {
  const V3d light = rgb * to_cone;
  return {respond(light.x), respond(light.y), respond(light.z)};
}

Aces2::JMh Aces2::Appearance::jmh(const V3d& rgb) const {
  const V3d aab = cone(rgb) * to_aab;
  if (aab[0] <= 0) return {};
  const double degrees = std::atan2(aab[2], aab[1]) * 180.0 / std::numbers::pi;
  return {J_of_response(aab[0]), std::hypot(aab[1], aab[2]), degrees < 0 ? degrees + 360.0 : degrees};
}

V3d Aces2::Appearance::rgb(const JMh& jmh) const {
  const double h = radians(jmh.h);
  const V3d aab(response_of(jmh.J), jmh.M * std::cos(h), jmh.M * std::sin(h));
  const V3d response = aab * from_aab;
  return V3d(light_of(response.x), light_of(response.y), light_of(response.z)) * from_cone;
}

Aces2::Aces2(double peak_nits, const Chromaticities& limiting)
    : peak_(peak_nits / kReference),
      scene_(chromaticities(v1::PRIMARIES_ACES_AP0)),
      reach_(chromaticities(v1::PRIMARIES_ACES_AP1)),
      display_(limiting),
      tone_(peak_nits),
      limit_J_(J_of(peak_nits)),
      mid_J_(J_of(tone_.c_t * kReference)),
      focus_distance_(1.35 + 1.35 * 1.75 * tone_.log_peak),
      bottom_gamma_(1.0 / (1.14 + 0.07 * tone_.log_peak)),
      to_ap1_(to_xyz(chromaticities(v1::PRIMARIES_ACES_AP0)) *
              to_xyz(chromaticities(v1::PRIMARIES_ACES_AP1)).inverse()),
      from_ap1_(to_ap1_.inverse()) {
  CHECK(peak_nits >= 100.0 && peak_nits <= 10000.0);
  make_reach();
  // The corners of the display's gamut, and where AP1's reach the largest lightness.
  std::vector<JMh> reach_corners, corners;
  std::vector<V3d> corner_rgb;
  const double limit_A = response_of(limit_J_);
  for (int i = 0; i < kCorners; ++i) {
    double low = 0, high = 8.0 * tone_.r_hit;
    while (high - low > 1e-3) {
      const double middle = (low + high) / 2.0;
      (reach_.achromatic(corner(i) * middle) < limit_A ? low : high) = middle;
    }
    reach_corners.push_back(reach_.jmh(corner(i) * high));
    corner_rgb.push_back(corner(i) * peak_);
    corners.push_back(display_.jmh(corner_rgb.back()));
  }
  make_hues(reach_corners, corners);
  make_cusps(corners, corner_rgb);
}

// The search's steps and ends are part of the transform: its tables are not more exact than that.
void Aces2::make_reach() {
  const auto outside = [this](double M, int hue) {
    const V3d rgb = reach_.rgb({limit_J_, M, static_cast<double>(hue)});
    return rgb.x < 0 || rgb.y < 0 || rgb.z < 0;
  };
  for (int hue = 0; hue < kHues; ++hue) {
    double low = 0, high = 50;
    while (high < 1300 && !outside(high, hue)) {
      low = high;
      high += 50;
    }
    while (high - low > 1e-2) {
      const double middle = (high + low) / 2.0;
      (outside(middle, hue) ? high : low) = middle;
    }
    reach_table_.push_back(high);
  }
}

// A hue for each degree, as even as it can be with all corners among them.
void Aces2::make_hues(const std::vector<JMh>& reach_corners, const std::vector<JMh>& display_corners) {
  std::vector<double> sorted;
  for (const std::vector<JMh>* corners : {&reach_corners, &display_corners}) {
    for (const JMh& one : *corners) sorted.push_back(one.h);
  }
  std::ranges::sort(sorted);
  sorted.erase(std::ranges::unique(sorted).begin(), sorted.end());
  std::vector<int> places;
  int last = -1, least = sorted[0] == 0 ? 0 : 1;
  for (size_t i = 0; i < sorted.size(); ++i) {
    int place = std::min(std::max(static_cast<int>(std::round(sorted[i])), least), kHues - 1);
    if (place == last) {
      if (i > 1 && places[i - 2] != places[i - 1] - 1) {
        --places[i - 1];
      } else {
        ++place;
      }
    }
    places.push_back(std::min(place, kHues - 1));
    last = least = place;
  }
  places.push_back(kHues);
  sorted.push_back(360.0);
  int begin = 0;
  double from = 0;
  for (size_t i = 0; i < sorted.size(); ++i) {
    const int count = places[i] - begin;
    for (int k = 0; k < count; ++k) hues_.push_back(from + k * (sorted[i] - from) / count);
    begin = places[i];
    from = sorted[i];
  }
  CHECK(hues_.size() == kHues);
  hues_.insert(hues_.begin(), hues_.back() - 360.0);
  hues_.push_back(hues_[1] + 360.0);
}

void Aces2::make_cusps(const std::vector<JMh>& corners, const std::vector<V3d>& corner_rgb) {
  const auto first = static_cast<size_t>(std::ranges::min_element(corners, {}, &JMh::h) - corners.begin());
  const auto at = [first](size_t i) { return (first + i) % kCorners; };
  cusps_.resize(hues_.size());
  for (size_t i = 1; i <= kHues; ++i) {
    // The edge of the cube from one corner to the next, on which the hue lies.
    size_t upper = 0;
    while (upper < kCorners && corners[at(upper)].h <= hues_[i]) ++upper;
    const size_t lower = upper + kCorners - 1;
    const double low_hue = corners[at(lower)].h - (upper == 0 ? 360.0 : 0.0);
    const double high_hue = corners[at(upper)].h + (upper == kCorners ? 360.0 : 0.0);
    double low = 0, high = 1;
    JMh found = corners[at(lower)];
    if (low_hue != hues_[i]) {
      const auto point = [&](double t) {
        return display_.jmh(corner_rgb[at(lower)] * (1.0 - t) + corner_rgb[at(upper)] * t);
      };
      while (high - low > 1e-7) {
        const double middle = (low + high) / 2.0;
        const double h = point(middle).h;
        const bool beyond = h < low_hue || (h < high_hue && h > hues_[i]);
        (beyond ? high : low) = middle;
      }
      found = point((low + high) / 2.0);
    }
    cusps_[i] = {found.J, found.M * kCuspGain, 0};
    // The least exponent, in steps of 0.4 and then by halves, whose hull contains the display's gamut.
    double below = 0, above = 0.4;
    const auto contains = [&](double exponent) {
      return contains_hull({cusps_[i].J, cusps_[i].M, 1.0 / exponent}, hues_[i]);
    };
    while (above < 5.0 && !contains(above)) {
      below = above;
      above += 0.4;
    }
    while (above - below > 1e-5) {
      const double middle = (above + below) / 2.0;
      (contains(middle) ? above : below) = middle;
    }
    cusps_[i].top_gamma = 1.0 / above;
  }
  cusps_.front() = cusps_[kHues];
  cusps_.back() = cusps_[1];
}

// True if the approximate boundary above the cusp leaves no colour of the display outside, at this hue.
bool Aces2::contains_hull(const Cusp& cusp, double hue) const {
  for (const double position : {0.01, 0.1, 0.5, 0.8, 0.99}) {
    const Line line = line_through(std::lerp(cusp.J, limit_J_, position), cusp.M, cusp);
    const double M = boundary_M(line, cusp);
    const V3d rgb = display_.rgb({line.source + line.slope * M, M, hue}) / peak_;
    if (!(rgb.x > 1 || rgb.y > 1 || rgb.z > 1)) return false;
  }
  return true;
}

double Aces2::focus_J(const Cusp& cusp) const {
  return std::lerp(cusp.J, mid_J_, std::min(1.0, kMidBlend - cusp.J / limit_J_));
}

Aces2::Line Aces2::line_through(double J, double M, const Cusp& cusp) const {
  const double focus = focus_J(cusp);
  double gain = 1.0;
  if (const double threshold = std::lerp(cusp.J, limit_J_, kGainBlend); J > threshold) {
    const double ratio = (limit_J_ - threshold) / std::max(0.0001, limit_J_ - std::min(limit_J_, J));
    gain = std::pow(std::log10(ratio), kGainPower) + 1.0;
  }
  const double slope_gain = limit_J_ * focus_distance_ * gain;
  const auto crosses_axis = [&](double j, double m) {
    const double a = m / (focus * slope_gain);
    if (j < focus) {
      const double b = 1.0 - m / slope_gain;
      return -2.0 * j / (-b - std::sqrt(b * b + 4.0 * a * j));
    }
    const double b = -(1.0 + m / slope_gain + limit_J_ * a);
    const double c = limit_J_ * m / slope_gain + j;
    return 2.0 * c / (-b + std::sqrt(b * b - 4.0 * a * c));
  };
  const double source = crosses_axis(J, M);
  const double reach = source < focus ? source : limit_J_ - source;
  return {source, crosses_axis(cusp.J, cusp.M), reach * (source - focus) / (focus * slope_gain)};
}

double Aces2::boundary_M(const Line& line, const Cusp& cusp) const {
  const double lower = meets_hull(line.source, line.slope, bottom_gamma_, cusp.J, cusp.M, line.cusp);
  const double upper = meets_hull(limit_J_ - line.source, -line.slope, cusp.top_gamma, limit_J_ - cusp.J,
                                  cusp.M, limit_J_ - line.cusp);
  return smooth_minimum(lower, upper, cusp.M);
}

double Aces2::reach_M_at(double hue) const {
  const int below = std::clamp(static_cast<int>(hue), 0, kHues - 1);
  return std::lerp(reach_table_[below], reach_table_[(below + 1) % kHues], hue - below);
}

Aces2::Cusp Aces2::cusp_at(double hue) const {
  const auto found = std::lower_bound(hues_.begin() + 1, hues_.end() - 1, hue);
  const auto upper = static_cast<size_t>(found - hues_.begin());
  const Cusp &a = cusps_[upper - 1], &b = cusps_[upper];
  const double t = (hue - hues_[upper - 1]) / (hues_[upper] - hues_[upper - 1]);
  return {std::lerp(a.J, b.J, t), std::lerp(a.M, b.M, t), std::lerp(a.top_gamma, b.top_gamma, t)};
}

Aces2::Chroma Aces2::chroma_compression() const {
  return {std::max(0.2, 1.3 - 1.3 * 0.69 * tone_.log_peak), 0.5 / (peak_ * kReference),
          2.4 + 2.4 * 3.3 * tone_.log_peak, std::pow(0.03379 * peak_ * kReference, 0.30596) - 0.45135};
}

// The colourfulness of a scene colour whose lightness becomes J.
double Aces2::compress_chroma(const JMh& scene, double J, double reach_M) const {
  if (scene.M == 0) return 0;
  const Chroma chroma = chroma_compression();
  const double nJ = J / limit_J_, rest = std::max(0.0, 1.0 - nJ);
  const double norm = chroma_norm(scene.h) * chroma.scale;
  const double limit = std::pow(nJ, 1.0 / kGamma) * reach_M / norm;
  double M = scene.M * std::pow(J / scene.J, 1.0 / kGamma) / norm;
  M = limit - toe(limit - M, limit - 0.001, rest * chroma.saturation, std::sqrt(nJ * nJ + chroma.threshold));
  return toe(M, limit, nJ * chroma.strength, rest) * norm;
}

Aces2::JMh Aces2::compress_gamut(const JMh& colour, double reach_M) const {
  if (colour.J <= 0) return {0, 0, colour.h};
  if (colour.M <= 0 || colour.J > limit_J_) return {colour.J, 0, colour.h};
  const Cusp cusp = cusp_at(colour.h);
  const Line line = line_through(colour.J, colour.M, cusp);
  const double boundary = boundary_M(line, cusp);
  if (boundary <= 0) return {colour.J, 0, colour.h};
  const double reach = meets_hull(line.source, line.slope, 1.0 / kGamma, limit_J_, reach_M, limit_J_);
  const double proportion = std::max(boundary / reach, kThreshold);
  const double threshold = proportion * boundary;
  double M = colour.M;
  if (proportion < 1 && M > threshold) {
    const double gamut = boundary - threshold, far = reach - threshold;
    const double scale = far / (far / gamut - 1.0);
    const double nd = (M - threshold) / scale;
    M = threshold + scale * nd / (1.0 + nd);
  }
  return {line.source + M * line.slope, M, colour.h};
}

std::array<double, 3> Aces2::display(const std::array<double, 3>& aces2065_1) const {
  const V3d ap1 = V3d(aces2065_1[0], aces2065_1[1], aces2065_1[2]) * to_ap1_;
  return display_of_ap1({ap1.x, ap1.y, ap1.z});
}

std::array<double, 3> Aces2::display_of_ap1(const std::array<double, 3>& light) const {
  V3d ap1;
  for (int i = 0; i < 3; ++i) ap1[i] = std::clamp(light[i], 0.0, 8.0 * tone_.r_hit);
  const JMh scene = scene_.jmh(ap1 * from_ap1_);
  const double J = tone_(scene.J);
  const double reach_M = reach_M_at(scene.h);
  const JMh colour = compress_gamut({J, compress_chroma(scene, J, reach_M), scene.h}, reach_M);
  const V3d rgb = display_.rgb(colour);
  const auto cut = [this](double v) { return std::clamp(v, 0.0, peak_); };
  return {cut(rgb.x), cut(rgb.y), cut(rgb.z)};
}

namespace {

using Element = std::array<float, 4>;

Element element(double r, double g, double b, double a) {
  return {static_cast<float>(r), static_cast<float>(g), static_cast<float>(b), static_cast<float>(a)};
}

// The hue, 0 .. 360 degrees, at a place along the diamond |cos| + |sin| = 1, 0 .. 4.
double hue_at(double place) {
  const double quadrant = std::floor(place), along = place - quadrant;
  const double degrees = std::atan2(along, 1.0 - along) * 180.0 / std::numbers::pi + 90.0 * quadrant;
  return std::fmod(degrees, 360.0);
}

constexpr double kReferenceNits = 100.0;  // of Aces2's 1.0

// The transform for a display, and its table.
struct Made {
  explicit Made(const Aces2Display& display)
      : transform(display.peak_nits, chromaticities(display.limit)),
        table(
            std::make_shared<const ColorTable>(ColorTable{.values = {}, .elements = transform.elements()})) {}
  const Aces2 transform;
  const std::shared_ptr<const ColorTable> table;
};

const Made& made_for(const Aces2Display& display) {
  // That of SDR, and for each peak those of P3-D65 and of Rec.2020.
  static std::array<std::once_flag, 1 + 2 * std::size(kAces2HdrPeaks)> once;
  static std::array<const Made*, std::size(once)> made;
  size_t i = 0;
  if (display.limit != v1::PRIMARIES_REC709) {
    CHECK(aces_2_has_peak(display.peak_nits));
    const auto peak = std::ranges::find(kAces2HdrPeaks, display.peak_nits) - std::begin(kAces2HdrPeaks);
    i = 1 + 2 * static_cast<size_t>(peak) + (display.limit == v1::PRIMARIES_REC2020 ? 1 : 0);
  }
  std::call_once(once[i], [&] { made[i] = new Made(display); });
  return *made[i];
}

}  // namespace

std::array<double, 3> aces_2(const std::array<double, 3>& exposed, const Aces2Display& display) {
  static constexpr double kToAp1[] = {TABLE_FROM_SCENE_AP1};
  std::array<double, 3> light{};
  for (size_t i = 0; i < 9; ++i) light[i / 3] += kToAp1[i] * exposed[i % 3];
  light = made_for(display).transform.display_of_ap1(light);
  for (double& v : light) v *= kReferenceNits / display.peak_nits;
  return light;
}

std::shared_ptr<const ColorTable> aces_2_table(const Aces2Display& display) {
  return made_for(display).table;
}

std::vector<Element> Aces2::elements() const {
  std::vector<Element> out;
  add_constants(out);
  add_tone_pieces(out);
  CHECK(out.size() == shader::ACES2_HUE_BEGIN);
  for (uint32_t i = 0; i <= shader::ACES2_HUES; ++i) {
    const double hue = hue_at(4.0 * i / shader::ACES2_HUES);
    const Cusp cusp = cusp_at(hue);
    out.push_back(element(cusp.J / limit_J_, cusp.M / limit_J_, cusp.top_gamma, reach_M_at(hue) / limit_J_));
  }
  return out;
}

void Aces2::add_constants(std::vector<Element>& out) const {
  const double white = aces2::response_of(limit_J_);
  // Lightness is in units of the white's response and colourfulness in those of limit_J_.
  const Imath::M33d unit(1, 0, 0, 0, 1 / limit_J_, 0, 0, 0, 1 / limit_J_);
  const Imath::M33d to_cone = from_ap1_ * scene_.to_cone * aces2::kAdaptedLight;
  const Imath::M33d to_aab = scene_.to_aab * unit;
  const Imath::M33d from_aab = Imath::M33d(white, 0, 0, 0, limit_J_, 0, 0, 0, limit_J_) * display_.from_aab;
  const Imath::M33d to_rgb = display_.from_cone * (1 / (aces2::kAdaptedLight * peak_));
  const Chroma chroma = chroma_compression();
  const double scalars[] = {8.0 * tone_.r_hit, white,
                            chroma.saturation, chroma.threshold,
                            chroma.strength,   chroma.scale / limit_J_,
                            mid_J_ / limit_J_, 1 / focus_distance_,
                            bottom_gamma_,     0.0001 / limit_J_};
  size_t scalar = 0;
  for (const Imath::M33d* m : {&to_cone, &to_aab, &from_aab, &to_rgb}) {
    for (int row = 0; row < 3; ++row, ++scalar) {
      // Imath multiplies row vectors from the left.
      out.push_back(element((*m)[0][row], (*m)[1][row], (*m)[2][row],
                            scalar < std::size(scalars) ? scalars[scalar] : 0.0));
    }
  }
  CHECK(out.size() == shader::ACES2_CONSTANTS);
}

// Appends the tone curve: from the scene's achromatic response to the display's, in units of white's. Each
// piece is a cubic polynomial that has the curve's values and slopes at its ends.
void Aces2::add_tone_pieces(std::vector<Element>& out) const {
  const double white = aces2::response_of(limit_J_);
  // Differences of it would show the last bits of a C library's powers.
  const auto toned = [&](double A) { return A > 0 ? tone_.response(A, portable_power) / white : 0; };
  const auto slope = [&](double A) {
    const double step = 1e-5 * A;
    return A > 0 ? (toned(A + step) - toned(A - step)) / (2 * step) : 0;
  };
  constexpr int kPerOctave = 1 << (23 - shader::ACES2_TONE_SHIFT);
  for (uint32_t i = 0; i < shader::ACES2_TONE_PIECES; ++i) {
    const auto begins = [](uint32_t piece) {
      const uint32_t octave = piece / kPerOctave;
      const double mantissa = 1.0 + static_cast<double>(piece % kPerOctave) / kPerOctave;
      return std::ldexp(shader::ACES2_TONE_KNEE * mantissa, static_cast<int>(octave)) -
             shader::ACES2_TONE_KNEE;
    };
    const double from = begins(i), to = begins(i + 1);
    const double y0 = toned(from), y1 = toned(to);
    const double m0 = slope(from) * (to - from), m1 = slope(to) * (to - from);
    out.push_back(element(y0, m0, 3 * (y1 - y0) - 2 * m0 - m1, 2 * (y0 - y1) + m0 + m1));
  }
}

}  // namespace candela
