// A colour transform as a 3D table, which the curves `aces-1` and TABLE look up (docs/pipeline.md section 5).
//
// A matrix takes exposed scene light, which is linear Rec.709, to the table's axes: the primaries in which
// film-like transforms work channel by channel. Light that is negative there is cut at 0. The lattice is in
// these primaries, with log-spaced axes. A point holds the square roots of its display light, in primaries
// that TABLE_TO_DISPLAY takes back to Rec.709. Between points the roots are interpolated over tetrahedra. So
// a table holds little more than one curve per channel. The cut to the display's gamut, which a lattice
// cannot represent, follows the table and is exact.
//
// The display light of a view is the view's value decoded by the sRGB curve, whatever encoding the view has.
// It may be outside [0, 1].
//
// The functions keep no state, so any thread may call them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "shaders/params.h"

namespace candela {

struct ColorTable {
  uint32_t size = 0;                  // points along a side, at least 2
  uint32_t axes = shader::AXES_ACES;  // AXES_*: the primaries of the axes
  // The light at the end of the axes, above 0. Light beyond it counts as the end.
  float end = 0.0f;
  // size^3 points of R, G and B; red varies fastest, then green. A value is root / TABLE_MAX_ROOT * 65535,
  // rounded.
  std::vector<uint16_t> values;
  // Of aces-2 alone, which has no points: what aces2.glsl evaluates it from.
  std::vector<std::array<float, 4>> elements = {};

  bool operator==(const ColorTable&) const = default;
};

// The exposed scene light at a table's points, R, G, B after R, G, B. Part of a lattice is outside the real
// colours, so some values are negative.
std::vector<float> lattice_light(uint32_t size, uint32_t axes, float end);

// The table of a transform that gives `display_light` for lattice_light(), point by point. Display light is
// clamped to -0.5 .. 1.5 first; NaN becomes -0.5.
ColorTable make_color_table(uint32_t size, uint32_t axes, float end, std::span<const float> display_light);

// The axes' approximation of log2(x) for x >= 1: e + m (4 - m) / 3 for x = 2^e (1 + m). Its slope has no
// steps, and it differs from log2 by at most 0.02.
double table_octaves(double x);

// Exposed scene light, clamped to 0 .. `end` per component in the table's primaries, as a table sees it; with
// AXES_AP1, light beyond the end first desaturates the colour. The result is in Rec.709 and may be negative.
std::array<float, 3> light_within_axes(const std::array<float, 3>& light, uint32_t axes, float end);

// The octaves from the beginning to the end of an axis.
double table_axis_octaves(uint32_t axes, float end);

// The light at point i of an axis of `size` points: 0 at the first and `end` at the last.
double table_axis_value(uint32_t i, uint32_t size, float end, uint32_t axes = shader::AXES_ACES);

}  // namespace candela
