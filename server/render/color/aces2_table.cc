#include "server/render/color/aces2_table.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <mutex>
#include <numbers>
#include <utility>

#include "server/base/check.h"
#include "server/render/color/aces2.h"
#include "server/render/color/portable_math.h"
#include "shaders/params.h"

namespace candela {
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
