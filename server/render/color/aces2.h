// The ACES 2.0 output transform in double precision: tone scale, chroma compression and gamut compression in
// the appearance space JMh. Source: Academy S-2024 "ACES Output Transform 2.0"
// (github.com/aces-aswf/aces-core, CTL), with the tables by hue as OpenColorIO 2.5 makes them.
#pragma once

#include <ImathMatrix.h>
#include <ImathVec.h>

#include <array>
#include <vector>

#include "server/render/color/aces2_tone.h"
#include "server/render/color/primaries.h"

namespace candela {

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

}  // namespace candela
