// ACES 2.0: what it does to grey, the whole transform, and the tables that the passes read. Any thread.
#pragma once

#include <ImathMatrix.h>
#include <ImathVec.h>

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "candela/v1/render.pb.h"
#include "server/render/color/primaries.h"
#include "shaders/color_table.h"

namespace candela::aces2 {

inline constexpr double kReference = 100.0;  // nit of 1.0, and of the white of the appearance space
extern const double kGamma;                  // of lightness over the achromatic response
extern const double kAdaptedLight;           // of 1 nit, in the cones' unit

// x^y for x >= 0 and y > 0: the C library's, or candela::portable_power().
using Power = double (*)(double x, double y);
double library_power(double x, double y);

// The response of a cone to light in nit, and back.
double respond(double light, Power power = library_power);
double light_of(double response, Power power = library_power);

// Lightness of an achromatic response, which is 1 for 100 nit, and back; and of grey of so many nit.
double J_of_response(double A);
double response_of(double J);
double J_of(double nits);

struct ToneScale {
  explicit ToneScale(double peak_nits);

  // The display's achromatic response to the scene's.
  double response(double A, Power power) const;
  // The same for lightness.
  double operator()(double J) const { return J_of_response(response(response_of(J), library_power)); }

  double g, t_1, c_t, s_2, m_2, r_hit, log_peak;
};

}  // namespace candela::aces2

namespace candela {

// The ACES 2.0 output transform in double precision: tone scale, chroma compression and gamut compression in
// the appearance space JMh. Source: Academy S-2024 "ACES Output Transform 2.0"
// (github.com/aces-aswf/aces-core, CTL), with the tables by hue as OpenColorIO 2.5 makes them.
//
// Any thread once it is made, which takes 10 ms.
class Aces2 {
 public:
  // A display of this peak (100 .. 10000 nit) whose pictures stay within the gamut of `limiting`.
  Aces2(double peak_nits, const Chromaticities& limiting);

  // Scene light in ACES2065-1 to display light with the limiting primaries. 1.0 is 100 nit; the result is
  // within 0 .. peak_nits / 100. Light outside of AP1 is cut to it.
  std::array<double, 3> display(const std::array<double, 3>& aces2065_1) const;
  // The same of light with the primaries of AP1.
  std::array<double, 3> display_of_ap1(const std::array<double, 3>& ap1) const;

  // The table that shaders/glsl/aces2.glsl reads: constants, tone curve, hues. Four floats an element.
  std::vector<std::array<float, 4>> elements() const;

 private:
  // Colour appearance: lightness, colourfulness and hue in degrees.
  struct JMh {
    double J = 0, M = 0, h = 0;
  };
  // From RGB of some primaries to JMh, as CIECAM16 with the viewing conditions of ACES.
  struct Appearance {
    explicit Appearance(const Chromaticities& primaries);

    double achromatic(const Imath::V3d& rgb) const { return (cone(rgb) * to_aab)[0]; }
    Imath::V3d cone(const Imath::V3d& rgb) const;
    JMh jmh(const Imath::V3d& rgb) const;
    Imath::V3d rgb(const JMh& jmh) const;

    Imath::M33d to_cone, from_cone, to_aab, from_aab;
  };
  // The most colourful point of the display's gamut at a hue.
  struct Cusp {
    double J = 0, M = 0, top_gamma = 0;  // of the hull above it: an exponent's inverse
  };
  // A line in the plane of a hue towards the grey axis, along which colours are compressed.
  struct Line {
    double source = 0,
           cusp = 0;  // lightness at which it crosses the axis, for the colour and through the cusp
    double slope = 0;
  };

  // The parameters of chroma compression. They depend on the peak only.
  struct Chroma {
    double saturation = 0, threshold = 0, strength = 0, scale = 0;
  };

  Chroma chroma_compression() const;
  double compress_chroma(const JMh& scene, double J, double reach_M) const;
  JMh compress_gamut(const JMh& colour, double reach_M) const;
  double focus_J(const Cusp& cusp) const;
  Line line_through(double J, double M, const Cusp& cusp) const;
  double boundary_M(const Line& line, const Cusp& cusp) const;
  double reach_M_at(double hue) const;
  Cusp cusp_at(double hue) const;

  void add_constants(std::vector<std::array<float, 4>>& out) const;
  void add_tone_pieces(std::vector<std::array<float, 4>>& out) const;
  void make_reach();
  void make_hues(const std::vector<JMh>& reach_corners, const std::vector<JMh>& display_corners);
  void make_cusps(const std::vector<JMh>& corners, const std::vector<Imath::V3d>& corner_rgb);
  bool contains_hull(const Cusp& cusp, double hue) const;

  const double peak_;  // of the display, in units of 100 nit
  const Appearance scene_, reach_, display_;
  const aces2::ToneScale tone_;
  const double limit_J_, mid_J_, focus_distance_, bottom_gamma_;
  const Imath::M33d to_ap1_, from_ap1_;  // of ACES2065-1
  std::vector<double> reach_table_;      // at whole degrees: the colourfulness of AP1 at limit_J_
  std::vector<double> hues_;             // of the cusps, from below 0 to beyond 360, ascending
  std::vector<Cusp> cusps_;
};

// The curve `aces-2`: ACES 2.0 for SDR video of 100 nit in Rec.709, and for HDR displays (docs/pipeline.md
// section 5).

// What it is made for.
struct Aces2Display {
  double peak_nits = 100.0;
  v1::Primaries limit = v1::PRIMARIES_REC709;  // its light is within their gamut, and in them
};

// The peaks of HDR displays for which the Academy has published it, in nit.
inline constexpr double kAces2HdrPeaks[] = {500, 1000, 2000, 4000};
constexpr bool aces_2_has_peak(double peak_nits) { return std::ranges::count(kAces2HdrPeaks, peak_nits) > 0; }

// Exposed scene light (Rec.709, linear, outside of its gamut also negative) to display-linear light, 0 .. 1
// at the peak, in double precision. Light outside of ACES AP1 is cut to it. An HDR display has the limit
// P3_D65 or REC2020, and aces_2_has_peak(). Any thread.
std::array<double, 3> aces_2(const std::array<double, 3>& exposed, const Aces2Display& display = {});

// What resolve computes it from; made once for each display, in 20 ms. Any thread.
std::shared_ptr<const ColorTable> aces_2_table(const Aces2Display& display = {});

}  // namespace candela
