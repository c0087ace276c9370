// Counts what the curve cuts of a `wide` frame, and how bright an image in PQ or HLG is; see
// shaders/resolve.comp.
#if defined(CANDELA_HOST_CUT_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_CUT_INL_H
#undef CANDELA_HOST_CUT_INL_H
#else
#define CANDELA_HOST_CUT_INL_H
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <bit>

#include "server/render/host/resolve/scene-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// Notes how far the scene's light is below 0, before bloom.
HWY_NOINLINE inline void note_negative(const RowPart& part, const Chunk& chunk, ResolveFound& found) {
  VF least = hn::Zero(kFloats);
  for (uint32_t i = 0; i < part.count; i += kLanes) {
    const vec3 c = chunk.rgb(i);
    least = hn::Min(least, min(min(c.r, c.g), c.b).v);
  }
  const float below = (0.0f - hn::GetLane(hn::MinOfLanes(kFloats, least))) * part.job.params.exposure;
  found.negative_light_bits = std::max(found.negative_light_bits, std::bit_cast<uint32_t>(below));
}

// A row of a matrix times a colour, each step rounded: the count is the same on every processor.
HWY_INLINE F precise_row(const float* m, const vec3& c) {
  return hn::Add(hn::Add(hn::Mul(set(m[0]), c.r.v), hn::Mul(set(m[1]), c.g.v)), hn::Mul(set(m[2]), c.b.v));
}

// The first matrix of the curve, from Rec.709 to where it cuts.
inline const float* curve_matrix(uint32_t curve, uint32_t display) {
  static constexpr float kRec709[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  static constexpr float kAces[9] = {TABLE_FROM_SCENE};
  static constexpr float kAp1[9] = {TABLE_FROM_SCENE_AP1};
  static constexpr float kAgx[9] = {AGX_INSET};
  static constexpr float kRec2020[9] = {REC709_TO_REC2020};
  static constexpr float kP3[9] = {REC709_TO_P3_D65};
  switch (curve) {
    case shader::CURVE_ACES_HILL:
    case shader::CURVE_ACES_1:
    case shader::CURVE_TABLE:
      return kAces;
    case shader::CURVE_TABLE_AP1:
    case shader::CURVE_ACES_2:
      return kAp1;
    case shader::CURVE_AGX:
      return kAgx;
    default:
      return display == shader::DISPLAY_REC2020  ? kRec2020
             : display == shader::DISPLAY_P3_D65 ? kP3
                                                 : kRec709;
  }
}

// Of exposed light. A table with the axes AP1 knows nothing of what is outside of AP1, so its error there is
// not that of a rounding.
HWY_NOINLINE inline void count_cut(const RowPart& part, const Chunk& chunk, ResolveFound& found) {
  const float* const matrix = curve_matrix(part.job.constants.curve, part.job.constants.display);
  const F roundings = -0x1p-20f;
  const F tolerance = -shader::GAMUT_TOLERANCE;
  VI outside = hn::Zero(kInts);
  VI cut = hn::Zero(kInts);
  const VI pixels = hn::LoadU(kInts, reinterpret_cast<const int32_t*>(kPixelOfLane.data()));
  for (uint32_t i = 0; i < part.count; i += kLanes) {
    const vec3 x = chunk.rgb(i);
    const F largest = max(max(abs(x.r), abs(x.g)), abs(x.b));
    const vec3 v = {precise_row(matrix, x), precise_row(matrix + 3, x), precise_row(matrix + 6, x)};
    const MF counted =
        hn::RebindMask(kFloats, hn::Lt(pixels, hn::Set(kInts, static_cast<int32_t>(part.count - i))));
    const auto add = [&](glsl::B which, VI* count) HWY_ATTR {
      *count = hn::Sub(*count, hn::BitCast(kInts, hn::VecFromMask(kFloats, hn::And(which.m, counted))));
    };
    const F limit = tolerance * largest;
    add(v.r < limit, &cut);
    add(v.g < limit, &cut);
    add(v.b < limit, &cut);
    add(min(min(v.r, v.g), v.b) < F(roundings * largest), &outside);
  }
  found.gamut_cut_components += static_cast<uint32_t>(hn::GetLane(hn::SumOfLanes(kInts, cut)));
  const bool some = hn::GetLane(hn::SumOfLanes(kInts, outside)) != 0;
  if (some && part.job.constants.curve == shader::CURVE_TABLE_AP1) found.negative_light_bits = 0x7f800000u;
}

// Of display light.
HWY_NOINLINE inline void note_shown(const RowPart& part, const Chunk& chunk, ResolveFound& found) {
  VF most = hn::Zero(kFloats);
  VI sum = hn::Zero(kInts);
  const VI pixels = hn::LoadU(kInts, reinterpret_cast<const int32_t*>(kPixelOfLane.data()));
  for (uint32_t i = 0; i < part.count; i += kLanes) {
    const vec3 light = chunk.rgb(i);
    const F largest = max(max(light.r, light.g), light.b);
    const auto counted =
        hn::RebindMask(kFloats, hn::Lt(pixels, hn::Set(kInts, static_cast<int32_t>(part.count - i))));
    most = hn::Max(most, hn::IfThenElseZero(counted, largest.v));
    const F scaled = largest * shader::SHOWN_SCALE + F(0.5);
    sum = hn::Add(sum, hn::ConvertTo(kInts, hn::IfThenElseZero(counted, scaled.v)));
  }
  found.shown_max_bits =
      std::max(found.shown_max_bits, std::bit_cast<uint32_t>(hn::GetLane(hn::MaxOfLanes(kFloats, most))));
  found.shown_sum += static_cast<uint32_t>(hn::GetLane(hn::SumOfLanes(kInts, sum)));
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
