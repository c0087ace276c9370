// Pixels of the wire as vectors of floats: the same arithmetic as shaders/glsl/input.glsl, for each target of
// Highway.
//
// Lane order: a vector holds kLanes neighbouring pixels of a row, B = kLanes / 4 to a block of four lanes.
// Lane i of block b holds pixel i * B + b, because transposing whole blocks needs the fewest instructions. So
// eight lanes hold the pixels 0 2 4 6 1 3 5 7. natural() restores the order of the row.
#if defined(CANDELA_HOST_LANES_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_LANES_INL_H
#undef CANDELA_HOST_LANES_INL_H
#else
#define CANDELA_HOST_LANES_INL_H
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "shaders/params.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

#if CANDELA_HOST_TARGET

namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<DF>;
using DU = hn::RebindToUnsigned<DF>;
using VF = hn::Vec<DF>;
using VI = hn::Vec<DI>;
using VU = hn::Vec<DU>;
using MF = hn::Mask<DF>;
inline constexpr DF kFloats;
inline constexpr DI kInts;
inline constexpr DU kUints;
inline constexpr size_t kLanes = hn::MaxLanes(kFloats);
inline constexpr size_t kBlocks = kLanes / 4;

// The pixel in each lane, and the lane of each pixel.
inline constexpr auto kPixelOfLane = [] {
  std::array<uint32_t, kLanes> pixels{};
  for (uint32_t lane = 0; lane < kLanes; ++lane) pixels[lane] = lane % 4 * kBlocks + lane / 4;
  return pixels;
}();
inline constexpr auto kLaneOfPixel = [] {
  std::array<uint32_t, kLanes> lanes{};
  for (uint32_t lane = 0; lane < kLanes; ++lane) lanes[kPixelOfLane[lane]] = lane;
  return lanes;
}();

// From lane order to the order of the row, and back.
template <typename Vec>
HWY_INLINE Vec natural(Vec v) {
  if constexpr (kBlocks == 1) return v;
  return hn::TableLookupLanes(v, hn::SetTableIndices(hn::DFromV<Vec>(), kLaneOfPixel.data()));
}
template <typename Vec>
HWY_INLINE Vec in_lane_order(Vec v) {
  if constexpr (kBlocks == 1) return v;
  return hn::TableLookupLanes(v, hn::SetTableIndices(hn::DFromV<Vec>(), kPixelOfLane.data()));
}

HWY_INLINE VF set(float x) { return hn::Set(kFloats, x); }
HWY_INLINE VI bits(VF x) { return hn::BitCast(kInts, x); }
HWY_INLINE VF floats(VI x) { return hn::BitCast(kFloats, x); }

// `count` floats, fewer than kLanes, and zeros. Highway's masked loads and stores may touch the others.
HWY_INLINE VF load_some(const float* from, size_t count) {
  HWY_ALIGN float lanes[kLanes] = {};
  std::memcpy(lanes, from, count * sizeof(float));
  return hn::Load(kFloats, lanes);
}
HWY_INLINE void store_some(VF v, float* to, size_t count) {
  HWY_ALIGN float lanes[kLanes];
  hn::Store(v, kFloats, lanes);
  std::memcpy(to, lanes, count * sizeof(float));
}
// The first `count` floats, or all of the vector if there are fewer.
HWY_INLINE void store(VF v, float* to, size_t count) {
  count >= kLanes ? hn::StoreU(v, kFloats, to) : store_some(v, to, count);
}

// x without its fraction. |x| < 2^31: Highway's own conversion pays for what is beyond.
HWY_INLINE VI truncate_small(VF x) {
#if HWY_TARGET == HWY_AVX2
  return VI{_mm256_cvttps_epi32(x.raw)};
#elif HWY_TARGET == HWY_AVX3
  return VI{_mm512_cvttps_epi32(x.raw)};
#else
  return hn::ConvertTo(kInts, x);
#endif
}

// table[index % 16], lane by lane. The table is aligned to 64 bytes.
HWY_INLINE VF look_up(const std::array<float, 16>& table, VU index) {
#if HWY_TARGET == HWY_AVX3
  return VF{_mm512_permutexvar_ps(index.raw, _mm512_load_ps(table.data()))};
#elif HWY_TARGET == HWY_AVX2
  const __m256 low = _mm256_permutevar8x32_ps(_mm256_load_ps(table.data()), index.raw);
  const __m256 high = _mm256_permutevar8x32_ps(_mm256_load_ps(table.data() + 8), index.raw);
  return VF{_mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32(index.raw, 28)))};
#else
  return hn::GatherIndex(kFloats, table.data(), hn::BitCast(kInts, hn::And(index, hn::Set(kUints, 15))));
#endif
}

// kLanes pixels in lane order.
struct Pixels {
  VF r, g, b, a;
};

constexpr size_t texel_bytes(uint32_t pixels) {
  return pixels == shader::PIXELS_RGBA16F ? 8 : pixels == shader::PIXELS_RGBA32F ? 16 : 4;
}

// kLanes components R G B A R G B ... as floats.
template <uint32_t kPixels>
HWY_INLINE VF load_components(const std::byte* at) {
  if constexpr (kPixels == shader::PIXELS_RGBA16F) {
    const hn::Rebind<hwy::float16_t, DF> halves;
    return hn::PromoteTo(kFloats, hn::LoadU(halves, reinterpret_cast<const hwy::float16_t*>(at)));
  } else {
    return hn::LoadU(kFloats, reinterpret_cast<const float*>(at));
  }
}

// E5B9G9R9: 9-bit mantissas without a hidden bit and an exponent with bias 15. Exact in float.
HWY_INLINE Pixels unpack_rgb9e5(VU words) {
  const VU exponent = hn::Add(hn::ShiftRight<27>(words), hn::Set(kUints, 103));
  const VF scale = hn::BitCast(kFloats, hn::ShiftLeft<23>(exponent));  // 2^(e - 15 - 9)
  const VU mantissa = hn::Set(kUints, 0x1ff);
  const auto component = [&](VU shifted) HWY_ATTR {
    return hn::Mul(hn::ConvertTo(kFloats, hn::BitCast(kInts, hn::And(shifted, mantissa))), scale);
  };
  return {component(words), component(hn::ShiftRight<9>(words)), component(hn::ShiftRight<18>(words)),
          set(1.0f)};
}

// The wire's pixels at `at` in the format PIXELS_*. It reads kLanes of them, whatever their alignment.
template <uint32_t kPixels>
HWY_INLINE Pixels load_pixels(const std::byte* at) {
  if constexpr (kPixels == shader::PIXELS_RGB9E5) {
    return unpack_rgb9e5(in_lane_order(hn::LoadU(kUints, reinterpret_cast<const uint32_t*>(at))));
  } else {
    constexpr size_t kStep = kLanes / 4 * texel_bytes(kPixels);
    const VF p0 = load_components<kPixels>(at);
    const VF p1 = load_components<kPixels>(at + kStep);
    const VF p2 = load_components<kPixels>(at + 2 * kStep);
    const VF p3 = load_components<kPixels>(at + 3 * kStep);
    const hn::Repartition<double, DF> pairs;
    const auto rg0 = hn::BitCast(pairs, hn::InterleaveLower(kFloats, p0, p1));
    const auto rg2 = hn::BitCast(pairs, hn::InterleaveLower(kFloats, p2, p3));
    const auto ba0 = hn::BitCast(pairs, hn::InterleaveUpper(kFloats, p0, p1));
    const auto ba2 = hn::BitCast(pairs, hn::InterleaveUpper(kFloats, p2, p3));
    return {hn::BitCast(kFloats, hn::InterleaveLower(pairs, rg0, rg2)),
            hn::BitCast(kFloats, hn::InterleaveUpper(pairs, rg0, rg2)),
            hn::BitCast(kFloats, hn::InterleaveLower(pairs, ba0, ba2)),
            hn::BitCast(kFloats, hn::InterleaveUpper(pairs, ba0, ba2))};
  }
}

// A part of a row that ends before a vector does: kCount pixels of the wire from pixel `first` on, of a row
// of `width`, with the last one repeated. It reads only pixels of the row.
template <uint32_t kPixels, size_t kCount = kLanes>
struct PartOfRow {
  HWY_ALIGN std::byte bytes[kCount * texel_bytes(kPixels)];

  PartOfRow(const std::byte* row, uint32_t first, uint32_t width) {
    constexpr size_t kBytes = texel_bytes(kPixels);
    for (uint32_t i = 0; i < kCount; ++i) {
      std::memcpy(bytes + i * kBytes, row + std::min(first + i, width - 1) * kBytes, kBytes);
    }
  }
};

// Rec.709 luminance in the order that docs/pipeline.md section 2 fixes, without fused operations.
HWY_INLINE VF luminance(VF r, VF g, VF b) {
  const VF rg = hn::Add(hn::Mul(set(0.2126f), r), hn::Mul(set(0.7152f), g));
  return hn::Add(rg, hn::Mul(set(0.0722f), b));
}

// max(x, 0) with the bits of common.glsl's at_least().
HWY_INLINE VF without_negatives(VF x) { return floats(hn::Max(bits(x), hn::Zero(kInts))); }

// Rounds to the nearest half, ties to even; the result is a float. Right only for |x| <= 65504.
HWY_INLINE VF round_to_half(VF x) {
  const hn::Rebind<hwy::float16_t, DF> halves;
  return hn::PromoteTo(kFloats, hn::DemoteTo(halves, x));
}

HWY_INLINE VF clamp_to(float most, VF x) { return hn::Min(hn::Max(x, set(-most)), set(most)); }
HWY_INLINE VF clamp_to_half(VF x) { return clamp_to(shader::MAX_HALF, x); }
HWY_INLINE MF is_infinite(VF x) { return hn::Eq(hn::Abs(x), floats(hn::Set(kInts, 0x7f800000))); }
HWY_INLINE VF scrub_alpha(VF x) { return hn::IfThenZeroElse(hn::IsNaN(x), clamp_to_half(x)); }
HWY_INLINE VF scrub_light(VF x) {
  const VF finite = hn::IfThenZeroElse(hn::IsNaN(x), clamp_to(shader::MAX_LIGHT, x));
  return hn::IfThenElse(is_infinite(x), clamp_to_half(x), finite);
}
HWY_INLINE Pixels scrub(const Pixels& c) {
  return {scrub_light(c.r), scrub_light(c.g), scrub_light(c.b), scrub_alpha(c.a)};
}

// How the scene is made of the wire's pixels. Without `scrub` pixels are right only if every component is
// finite and within +-MAX_HALF, on the wire and in the scene.
struct Input {
  const shader::InputParams& frame;
  uint32_t pixels;  // PIXELS_*
  bool matrix;
  bool scrub;

  bool rounds() const { return pixels == shader::PIXELS_RGBA32F || matrix; }
};

// Primaries, in the order that docs/pipeline.md section 1 fixes.
HWY_INLINE Pixels to_scene_primaries(const shader::InputParams& m, const Pixels& c) {
  const auto row = [&](float x, float y, float z) HWY_ATTR {
    const VF xy = hn::Add(hn::Mul(set(x), c.r), hn::Mul(set(y), c.g));
    return hn::Add(xy, hn::Mul(set(z), c.b));
  };
  return {row(m.m00, m.m01, m.m02), row(m.m10, m.m11, m.m12), row(m.m20, m.m21, m.m22), c.a};
}

HWY_INLINE Pixels round_to_half(const Pixels& c) {
  return {round_to_half(c.r), round_to_half(c.g), round_to_half(c.b), round_to_half(c.a)};
}

// Scene pixels before they are clamped and rounded.
HWY_INLINE Pixels ingest_unclamped(const Input& input, const Pixels& wire) {
  const Pixels c = input.scrub ? scrub(wire) : wire;
  return input.matrix ? to_scene_primaries(input.frame, c) : c;
}

// Scene pixels before they are rounded.
HWY_INLINE Pixels ingest_unrounded(const Input& input, const Pixels& wire) {
  const Pixels c = ingest_unclamped(input, wire);
  if (!input.scrub || !input.matrix) return c;
  constexpr float kMost = shader::MAX_LIGHT;
  return {clamp_to(kMost, c.r), clamp_to(kMost, c.g), clamp_to(kMost, c.b), c.a};
}

// Components within the largest half rounded to half, the others as they are.
HWY_INLINE Pixels rounded(const Input& input, const Pixels& c) {
  const Pixels halves = round_to_half(c);
  if (!input.scrub) return halves;
  const VF most = set(shader::MAX_HALF);
  return {hn::IfThenElse(hn::Gt(hn::Abs(c.r), most), c.r, halves.r),
          hn::IfThenElse(hn::Gt(hn::Abs(c.g), most), c.g, halves.g),
          hn::IfThenElse(hn::Gt(hn::Abs(c.b), most), c.b, halves.b), halves.a};
}

// Scene pixels.
HWY_INLINE Pixels ingest(const Input& input, const Pixels& wire) {
  const Pixels c = ingest_unrounded(input, wire);
  return input.rounds() ? rounded(input, c) : c;
}

// Scene pixels for a curve that cuts: a colour with a negative component is not rounded.
HWY_INLINE Pixels ingest_wide(const Input& input, const Pixels& wire) {
  const Pixels c = ingest_unrounded(input, wire);
  if (!input.rounds()) return c;
  const Pixels round = rounded(input, c);
  const MF negative = hn::Lt(hn::Min(hn::Min(c.r, c.g), c.b), hn::Set(kFloats, shader::NEGATIVE_BELOW));
  return {hn::IfThenElse(negative, c.r, round.r), hn::IfThenElse(negative, c.g, round.g),
          hn::IfThenElse(negative, c.b, round.b), hn::IfThenElse(negative, c.a, round.a)};
}

#endif  // CANDELA_HOST_TARGET

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
