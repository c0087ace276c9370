// A colour transform as a 3D table: what the curves `aces-1` and TABLE look up (docs/pipeline.md section 5).
//
// Exposed scene light, linear Rec.709 and never negative, goes through TABLE_FROM_SCENE into the primaries in
// which film-like transforms work channel by channel. The lattice stands there, its axes log-spaced. A point
// holds the square roots of the display light there, in the primaries that TABLE_TO_DISPLAY takes back to
// Rec.709. Between points the roots are interpolated over tetrahedra. So what a table holds is nearly one
// curve a channel, and the cut to the display's gamut, which no lattice could hold, comes after it, exactly.
//
// The display light of a view is its value in [0, 1] decoded by the sRGB curve, whatever the view encodes
// for; it may lie beyond [0, 1].
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "shaders/params.h"

namespace candela {

struct ColorTable {
  uint32_t size = 0;  // points a side, at least 2
  uint32_t axes = shader::AXES_ACES;
  // Where the axes end, above 0; light beyond it counts as the end.
  float end = 0.0f;
  // size^3 points of R, G, B, red fastest, then green: root / TABLE_MAX_ROOT * 65535, rounded.
  std::vector<uint16_t> values;

  bool operator==(const ColorTable&) const = default;
};

// The exposed scene light of a table's points, R, G, B after R, G, B. A lattice lies partly outside of what
// is real, so that some of it is negative.
std::vector<float> lattice_light(uint32_t size, uint32_t axes, float end);

// The table of a transform that makes this display light of lattice_light's. Display light is cut to -0.5
// .. 1.5 first.
ColorTable make_color_table(uint32_t size, uint32_t axes, float end, std::span<const float> display_light);

// Octaves of x >= 1 above 1, as the axes count them: log2 with x = 2^e (1 + m) at e + m (4 - m) / 3, which
// has no step in its slope and is at most 0.02 octaves from the truth.
double table_octaves(double x);

// Exposed scene light as a table with axes to `end` sees it: where a component is beyond them in the table's
// primaries, it is cut there. The result may be negative.
std::array<float, 3> light_within_axes(const std::array<float, 3>& light, uint32_t axes, float end);

// What an axis of `size` points has at point i, 0 at the first and `end` at the last.
double table_axis_value(uint32_t i, uint32_t size, float end);

}  // namespace candela
