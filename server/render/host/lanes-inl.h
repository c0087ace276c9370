// What the kernels of the host compute with, for each target of Highway: pixels of the wire as vectors of
// floats, with the arithmetic of shaders/glsl/input.glsl, and GLSL's scalars and vectors over them.
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
#include <concepts>
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

// GLSL's scalars and vectors in C++, a vector register of pixels at a time: what shaders/glsl/*.glsl need to
// compile as C++. For each target of Highway.
//
// A shared file has no `if` or `?:` on data; mix(a, b, condition) says the same in both languages. It uses
// the components r, g and b. Its specialisation constants are template parameters here, its push constants
// and textures are members of the struct that includes it, between glsl-begin.h and glsl-end.h.
//
// Here a product that is added to something is not rounded before (Product). The compiler contracts nothing,
// so the bits are the same on every processor.
namespace candela::host::HWY_NAMESPACE::glsl {

#if CANDELA_HOST_TARGET

struct I;
struct U;

// A condition.
struct B {
  hn::Mask<DF> m;
};
HWY_INLINE B operator&&(B a, B b) { return {hn::And(a.m, b.m)}; }
HWY_INLINE B operator||(B a, B b) { return {hn::Or(a.m, b.m)}; }
HWY_INLINE B operator!(B a) { return {hn::Not(a.m)}; }

// A product of floats that is not rounded yet.
struct Product {
  VF a;
  VF b;
};

struct F {
  VF v;
  F() = default;
  HWY_INLINE F(VF x) : v(x) {}
  HWY_INLINE F(float x) : v(hn::Set(kFloats, x)) {}
  HWY_INLINE F(double x) : F(static_cast<float>(x)) {}
  HWY_INLINE F(const Product& x) : v(hn::Mul(x.a, x.b)) {}
  HWY_INLINE explicit F(int x) : F(static_cast<float>(x)) {}
  HWY_INLINE explicit F(uint32_t x) : F(static_cast<float>(x)) {}
  HWY_INLINE explicit F(const I& x);
  HWY_INLINE explicit F(const U& x);
};

HWY_INLINE Product operator*(F a, F b) { return {a.v, b.v}; }
HWY_INLINE F operator/(F a, F b) { return hn::Div(a.v, b.v); }
HWY_INLINE F operator+(F a, F b) { return hn::Add(a.v, b.v); }
HWY_INLINE F operator-(F a, F b) { return hn::Sub(a.v, b.v); }
HWY_INLINE F operator+(const Product& p, F c) { return hn::MulAdd(p.a, p.b, c.v); }
HWY_INLINE F operator+(F c, const Product& p) { return hn::MulAdd(p.a, p.b, c.v); }
HWY_INLINE F operator-(const Product& p, F c) { return hn::MulSub(p.a, p.b, c.v); }
HWY_INLINE F operator-(F c, const Product& p) { return hn::NegMulAdd(p.a, p.b, c.v); }
HWY_INLINE F operator+(const Product& p, const Product& q) { return p + F(q); }
HWY_INLINE F operator-(const Product& p, const Product& q) { return p - F(q); }
HWY_INLINE F operator-(F a) { return hn::Neg(a.v); }
HWY_INLINE B operator<(F a, F b) { return {hn::Lt(a.v, b.v)}; }
HWY_INLINE B operator<=(F a, F b) { return {hn::Le(a.v, b.v)}; }
HWY_INLINE B operator==(F a, F b) { return {hn::Eq(a.v, b.v)}; }

// What I and U have in common.
template <typename Self, typename Vec>
struct Integer {
  Vec v;
  friend HWY_INLINE Self operator+(Self a, Self b) { return hn::Add(a.v, b.v); }
  friend HWY_INLINE Self operator-(Self a, Self b) { return hn::Sub(a.v, b.v); }
  friend HWY_INLINE Self operator*(Self a, Self b) { return hn::Mul(a.v, b.v); }
  friend HWY_INLINE Self operator&(Self a, Self b) { return hn::And(a.v, b.v); }
  friend HWY_INLINE Self operator|(Self a, Self b) { return hn::Or(a.v, b.v); }
  friend HWY_INLINE Self operator^(Self a, Self b) { return hn::Xor(a.v, b.v); }
  friend HWY_INLINE B operator==(Self a, Self b) { return {hn::RebindMask(kFloats, hn::Eq(a.v, b.v))}; }
  friend HWY_INLINE Self mix(Self a, Self b, B which) {
    return hn::IfThenElse(hn::RebindMask(hn::DFromV<Vec>(), which.m), b.v, a.v);
  }
  friend HWY_INLINE Self& operator+=(Self& a, Self b) { return a = a + b; }
  friend HWY_INLINE Self operator<<(Self a, int bits) { return hn::ShiftLeftSame(a.v, bits); }
  friend HWY_INLINE Self operator>>(Self a, int bits) { return hn::ShiftRightSame(a.v, bits); }
};

struct I : Integer<I, VI> {
  I() = default;
  HWY_INLINE I(VI x) : Integer{x} {}
  HWY_INLINE I(int32_t x) : Integer{hn::Set(kInts, x)} {}
  HWY_INLINE explicit I(uint32_t x) : I(static_cast<int32_t>(x)) {}
  HWY_INLINE explicit I(F x) : Integer{truncate_small(x.v)} {}
  HWY_INLINE explicit I(const U& x);
};

struct U : Integer<U, VU> {
  U() = default;
  HWY_INLINE U(VU x) : Integer{x} {}
  HWY_INLINE U(uint32_t x) : Integer{hn::Set(kUints, x)} {}
  HWY_INLINE explicit U(const I& x) : Integer{hn::BitCast(kUints, x.v)} {}
};

HWY_INLINE I::I(const U& x) : Integer{hn::BitCast(kInts, x.v)} {}
HWY_INLINE F::F(const I& x) : v(hn::ConvertTo(kFloats, x.v)) {}
// x < 2^31.
HWY_INLINE F::F(const U& x) : F(I(x)) {}

HWY_INLINE U floatBitsToUint(F x) { return hn::BitCast(kUints, x.v); }
HWY_INLINE F uintBitsToFloat(U x) { return hn::BitCast(kFloats, x.v); }
HWY_INLINE F sqrt(F x) { return hn::Sqrt(x.v); }
HWY_INLINE F floor(F x) { return hn::Floor(x.v); }
HWY_INLINE F abs(F x) { return hn::Abs(x.v); }
HWY_INLINE F min(F a, F b) { return hn::Min(a.v, b.v); }
HWY_INLINE F max(F a, F b) { return hn::Max(a.v, b.v); }
HWY_INLINE F clamp(F x, F low, F high) { return min(max(x, low), high); }
HWY_INLINE I min(I a, I b) { return hn::Min(a.v, b.v); }
HWY_INLINE U min(U a, U b) { return hn::Min(a.v, b.v); }
HWY_INLINE U max(U a, U b) { return hn::Max(a.v, b.v); }
HWY_INLINE F mix(F a, F b, B which) { return hn::IfThenElse(which.m, b.v, a.v); }
HWY_INLINE F mix(F a, F b, F part) { return a * (1.0 - part) + b * part; }
// As common.glsl has them.
HWY_INLINE F at_least(F x, F low) { return max(x, low); }
HWY_INLINE F at_most(F x, F high) { return min(x, high); }

template <typename T>
struct Three {
  T r, g, b;
  Three() = default;
  HWY_INLINE Three(const T& x, const T& y, const T& z) : r(x), g(y), b(z) {}
  HWY_INLINE explicit Three(const T& x) : r(x), g(x), b(x) {}
  template <typename Other>
  HWY_INLINE explicit(!std::convertible_to<Other, T>) Three(const Three<Other>& x)
      : r(T(x.r)), g(T(x.g)), b(T(x.b)) {}
  template <typename Other>
  HWY_INLINE Three& operator-=(const Other& x) {
    return *this = *this - x;
  }
  template <typename Other>
  HWY_INLINE Three& operator^=(const Other& x) {
    return *this = *this ^ x;
  }
};

template <typename T>
inline constexpr bool kIsThree = false;
template <typename T>
inline constexpr bool kIsThree<Three<T>> = true;

// Component by component; a scalar stands for three of it.
#define CANDELA_EACH(op)                                                                           \
  template <typename X, typename Y>                                                                \
  HWY_INLINE auto operator op(const Three<X>& x, const Three<Y>& y)->Three<decltype(x.r op y.r)> { \
    return {x.r op y.r, x.g op y.g, x.b op y.b};                                                   \
  }                                                                                                \
  template <typename X, typename Y>                                                                \
  requires(!kIsThree<Y>) HWY_INLINE auto operator op(const Three<X>& x, const Y& y)                \
      ->Three<decltype(x.r op y)> {                                                                \
    return {x.r op y, x.g op y, x.b op y};                                                         \
  }                                                                                                \
  template <typename X, typename Y>                                                                \
  requires(!kIsThree<X>) HWY_INLINE auto operator op(const X& x, const Three<Y>& y)                \
      ->Three<decltype(x op y.r)> {                                                                \
    return {x op y.r, x op y.g, x op y.b};                                                         \
  }
CANDELA_EACH(+)
CANDELA_EACH(-)
CANDELA_EACH(*)
CANDELA_EACH(/)
CANDELA_EACH(&)
CANDELA_EACH(|)
CANDELA_EACH(^)
CANDELA_EACH(<<)
CANDELA_EACH(>>)
#undef CANDELA_EACH

using vec3 = Three<F>;
using uvec3 = Three<U>;
using ivec3 = Three<I>;
using bvec3 = Three<B>;

HWY_INLINE uvec3 floatBitsToUint(const vec3& x) {
  return {floatBitsToUint(x.r), floatBitsToUint(x.g), floatBitsToUint(x.b)};
}
HWY_INLINE vec3 uintBitsToFloat(const uvec3& x) {
  return {uintBitsToFloat(x.r), uintBitsToFloat(x.g), uintBitsToFloat(x.b)};
}
HWY_INLINE F dot(const vec3& x, const vec3& y) { return (x.r * y.r + x.g * y.g) + x.b * y.b; }
HWY_INLINE vec3 normalize(const vec3& x) { return x * F(1.0 / sqrt(dot(x, x))); }
HWY_INLINE vec3 reflect(const vec3& x, const vec3& n) { return x - F(2.0 * dot(n, x)) * n; }
HWY_INLINE vec3 sqrt(const vec3& x) { return {sqrt(x.r), sqrt(x.g), sqrt(x.b)}; }
HWY_INLINE vec3 abs(const vec3& x) { return {abs(x.r), abs(x.g), abs(x.b)}; }
HWY_INLINE vec3 at_least(const vec3& x, F low) {
  return {at_least(x.r, low), at_least(x.g, low), at_least(x.b, low)};
}
HWY_INLINE vec3 at_most(const vec3& x, F high) {
  return {at_most(x.r, high), at_most(x.g, high), at_most(x.b, high)};
}
HWY_INLINE bvec3 lessThanEqual(const vec3& x, const vec3& y) { return {x.r <= y.r, x.g <= y.g, x.b <= y.b}; }
HWY_INLINE B operator==(const vec3& x, const vec3& y) {
  return {hn::And(hn::And((x.r == y.r).m, (x.g == y.g).m), (x.b == y.b).m)};
}
HWY_INLINE vec3 mix(const vec3& a, const vec3& b, const bvec3& which) {
  return {mix(a.r, b.r, which.r), mix(a.g, b.g, which.g), mix(a.b, b.b, which.b)};
}
HWY_INLINE vec3 mix(const vec3& a, const vec3& b, F part) {
  return {mix(a.r, b.r, part), mix(a.g, b.g, part), mix(a.b, b.b, part)};
}
HWY_INLINE F luminance(const vec3& c) { return (0.2126 * c.r + 0.7152 * c.g) + 0.0722 * c.b; }

// A texel buffer of four words an element. A fetch beyond its end takes the last element.
struct utextureBuffer {
  const uint32_t* words = nullptr;
  uint32_t elements = 0;
};

// The elements at[0], at[4], at[8] ...: one for each 16 bytes of the vector.
template <typename D>
HWY_INLINE hn::Vec<D> load_elements(D d, const uint32_t* words, const uint32_t* at) {
  if constexpr (hn::MaxLanes(d) == 4) {
    return hn::LoadU(d, words + 4 * size_t{at[0]});
  } else {
    const hn::Half<D> half;
    return hn::Combine(d, load_elements(half, words, at + hn::MaxLanes(d) / 2),
                       load_elements(half, words, at));
  }
}

struct uvec4 {
  uvec3 rgb;
  U a;
};

// The elements `at`, one for each lane: whole elements and a transposition. Gathers take one word at a time.
HWY_INLINE uvec4 transposed_elements(const uint32_t* words, const uint32_t* at) {
  const VU e0 = load_elements(kUints, words, at);
  const VU e1 = load_elements(kUints, words, at + 1);
  const VU e2 = load_elements(kUints, words, at + 2);
  const VU e3 = load_elements(kUints, words, at + 3);
  const hn::Repartition<uint64_t, DU> pairs;
  const auto rg0 = hn::BitCast(pairs, hn::InterleaveLower(kUints, e0, e1));
  const auto rg2 = hn::BitCast(pairs, hn::InterleaveLower(kUints, e2, e3));
  const auto ba0 = hn::BitCast(pairs, hn::InterleaveUpper(kUints, e0, e1));
  const auto ba2 = hn::BitCast(pairs, hn::InterleaveUpper(kUints, e2, e3));
  return {uvec3(hn::BitCast(kUints, hn::InterleaveLower(pairs, rg0, rg2)),
                hn::BitCast(kUints, hn::InterleaveUpper(pairs, rg0, rg2)),
                hn::BitCast(kUints, hn::InterleaveLower(pairs, ba0, ba2))),
          hn::BitCast(kUints, hn::InterleaveUpper(pairs, ba0, ba2))};
}

// The same element for every lane.
HWY_INLINE uvec4 texelFetch(const utextureBuffer& texture, int index) {
  const uint32_t* const words = texture.words + 4 * index;
  return {uvec3(U(words[0]), U(words[1]), U(words[2])), U(words[3])};
}

HWY_INLINE uvec4 texelFetch(const utextureBuffer& texture, I index) {
  HWY_ALIGN uint32_t at[hn::MaxLanes(kUints)];
  hn::Store(min(U(index), U(texture.elements - 1)).v, kUints, at);
  return transposed_elements(texture.words, at);
}

#endif  // CANDELA_HOST_TARGET

}  // namespace candela::host::HWY_NAMESPACE::glsl
HWY_AFTER_NAMESPACE();

#endif
