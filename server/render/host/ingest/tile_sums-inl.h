// What ingest adds up over a tile, for each target of Highway, and how it adds up a run without anything
// unusual.
//
// A run is a tile's part of a row. Most runs are plain: no component is negative and none needs the scrub.
// For those a few instructions suffice: the light for bloom is the luminance, and nothing is counted.
#if defined(CANDELA_HOST_TILE_SUMS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_TILE_SUMS_INL_H
#undef CANDELA_HOST_TILE_SUMS_INL_H
#else
#define CANDELA_HOST_TILE_SUMS_INL_H
#endif

#include <hwy/cache_control.h>

#include <algorithm>

#include "server/render/host/lanes/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

#if CANDELA_HOST_TARGET

using DL = hn::RepartitionToWide<DU>;
using VL = hn::Vec<DL>;
inline constexpr DL kLongs;

constexpr uint32_t kTileTexels = shader::TILE_TEXELS;
// Bytes that are asked for before they are read.
constexpr size_t kAhead = 4096;
constexpr size_t kLine = 64;
constexpr int32_t kInfinity = 0x7f800000;
// The part of fixed_log2() that is the same for every texel.
constexpr uint32_t kLog2Offset = (127u - shader::LOG2_BIAS) << shader::LOG2_FRACTION_BITS;

// fixed_log2() of shaders/ingest.comp plus kLog2Offset. The polynomial's coefficients are
// 2^LOG2_FRACTION_BITS times the shader's. That is a power of two, so every step has the same bits.
HWY_INLINE VU fixed_log2(VF l) {
  constexpr auto kScale = static_cast<float>(1u << shader::LOG2_FRACTION_BITS);
  const VI b = hn::Max(bits(l), bits(set(shader::MIN_METERED_LUMINANCE)));
  const VI mantissa = hn::And(b, hn::Set(kInts, 0x007fffff));
  const VF t = hn::Sub(floats(hn::Or(mantissa, hn::Set(kInts, 0x3f800000))), set(1.0f));
  VF q = hn::Add(hn::Mul(set(-0.025691079f * kScale), t), set(0.121002205f * kScale));
  q = hn::Add(hn::Mul(q, t), set(-0.276540697f * kScale));
  q = hn::Add(hn::Mul(q, t), set(0.45652163f * kScale));
  q = hn::Add(hn::Mul(q, t), set(-0.71779108f * kScale));
  q = hn::Add(hn::Mul(q, t), set(1.44249535f * kScale));
  q = hn::Add(hn::Mul(q, t), set(1.8456825e-06f * kScale));
  const VI fraction = truncate_small(hn::Add(q, set(0.5f)));
  const VI exponent = hn::And(hn::ShiftRight<23 - shader::LOG2_FRACTION_BITS>(b),
                              hn::Set(kInts, -(1 << shader::LOG2_FRACTION_BITS)));
  return hn::BitCast(kUints, hn::Add(exponent, fraction));
}

// The sums over a tile. Those of vectors are lane by lane.
struct TileSums {
  VL log2_sum = hn::Zero(kLongs);
  VU weight_sum = hn::Zero(kUints);
  // Luminance as bits, ordered as integers.
  VI max_luminance = hn::Zero(kInts);
  VI min_luminance = hn::Set(kInts, 0x7fffffff);
  VI max_light = hn::Zero(kInts);
  VI max_magnitude = hn::Zero(kInts);
  uint32_t negative_components = 0;
  uint32_t negative_scene_components = 0;
  uint32_t nan_components = 0;
  uint32_t infinite_components = 0;
  uint32_t clamped_components = 0;
  uint32_t first_bad_texel = UINT32_MAX;
  uint32_t absent_texels = 0;
  uint32_t coverage = 0;  // as in TileRecord
  bool alpha_differs = false;

  TileSums() {}  // not an implicit one, which would be for the baseline's processors
};

HWY_INLINE VL add_wide(VL sum, VU v) {
  const VL pairs = hn::BitCast(kLongs, v);
  return hn::Add(sum, hn::Add(hn::And(pairs, hn::Set(kLongs, 0xffffffff)), hn::ShiftRight<32>(pairs)));
}

// The lanes of the first `count` pixels of a vector.
HWY_INLINE MF first_pixels(size_t count) {
  const VU pixel = hn::LoadU(kUints, kPixelOfLane.data());
  return hn::MaskFromVec(hn::BitCast(
      kFloats, hn::VecFromMask(kUints, hn::Lt(pixel, hn::Set(kUints, static_cast<uint32_t>(count))))));
}

uint32_t count_of(MF mask) { return static_cast<uint32_t>(hn::CountTrue(kFloats, mask)); }

// What a plain run needs of its wire words besides the luminance.
template <uint32_t kPixels>
struct PlainNotes;

// Sign bits and alphas are read from the halves: a vector has twice as many components of them as of floats.
template <>
struct PlainNotes<shader::PIXELS_RGBA16F> {
  VL any = hn::Zero(kLongs);  // the bits of R, G and B, and those by which alpha differs from 1

  PlainNotes() {}
  HWY_INLINE void add(const std::byte* at, const Pixels&) {
    const VL opaque_black = hn::Set(kLongs, uint64_t{0x3c00} << 48);
    for (size_t i = 0; i < 2; ++i) {
      const VL texels = hn::LoadU(kLongs, reinterpret_cast<const uint64_t*>(at) + i * kLanes / 2);
      any = hn::Or(any, hn::Xor(texels, opaque_black));
    }
  }
  // Finite unless the luminance is not: without negative components nothing cancels in it.
  HWY_INLINE bool plain(VI max_luminance) const {
    return none(0x0000800080008000) && hn::AllTrue(kInts, hn::Lt(max_luminance, hn::Set(kInts, kInfinity)));
  }
  HWY_INLINE bool opaque() const { return none(uint64_t{0xffff} << 48); }

 private:
  HWY_INLINE bool none(uint64_t bits_of_texel) const {
    return hn::AllTrue(kLongs, hn::Eq(hn::And(any, hn::Set(kLongs, bits_of_texel)), hn::Zero(kLongs)));
  }
};

template <>
struct PlainNotes<shader::PIXELS_RGBA32F> {
  VI largest = hn::Zero(kInts);
  VI any = hn::Zero(kInts);
  VI alpha = hn::Zero(kInts);

  PlainNotes() {}
  HWY_INLINE void add(const std::byte*, const Pixels& wire) {
    largest = hn::Max(largest, hn::Max(hn::Max(bits(wire.r), bits(wire.g)), bits(wire.b)));
    any = hn::Or(any, hn::Or(hn::Or(bits(wire.r), bits(wire.g)), bits(wire.b)));
    alpha = hn::Or(alpha, hn::Xor(bits(wire.a), bits(set(1.0f))));
  }
  HWY_INLINE bool plain(VI) const {
    return hn::AllFalse(kInts, hn::Lt(any, hn::Zero(kInts))) &&
           hn::AllFalse(kInts, hn::Gt(largest, bits(set(shader::MAX_HALF))));
  }
  HWY_INLINE bool opaque() const { return hn::AllTrue(kInts, hn::Eq(alpha, hn::Zero(kInts))); }
};

template <>
struct PlainNotes<shader::PIXELS_RGB9E5> {
  HWY_INLINE void add(const std::byte*, const Pixels&) {}
  HWY_INLINE bool plain(VI) const { return true; }
  HWY_INLINE bool opaque() const { return true; }
};

// Sums over a plain run without weights.
template <uint32_t kPixels>
struct PlainRun {
  const Input& input;
  PlainNotes<kPixels> notes;
  VU log2_sum = hn::Zero(kUints);
  VI max_luminance = hn::Zero(kInts);
  VI min_luminance = hn::Set(kInts, 0x7fffffff);

  explicit PlainRun(const Input& the_input) : input(the_input) {}

  // `counted` takes the texel's fixed_log2().
  template <typename Counted>
  HWY_INLINE void add(const std::byte* at, const Counted& counted) {
    const Pixels wire = load_pixels<kPixels>(at);
    notes.add(at, wire);
    const Pixels scene = ingest(input, wire);
    const VF l = luminance(scene.r, scene.g, scene.b);
    log2_sum = hn::Add(log2_sum, counted(fixed_log2(l)));
    max_luminance = hn::Max(max_luminance, bits(l));
    min_luminance = hn::Min(min_luminance, bits(l));
  }

  // Reads `count` texels. False if the run is not plain; then *sums is as before.
  HWY_INLINE bool meter(const std::byte* at, uint32_t count, TileSums& sums) {
    const VU offset = hn::Set(kUints, kLog2Offset);
    uint32_t vectors = count / kLanes;
    for (uint32_t i = 0; i < vectors; ++i, at += kLanes * texel_bytes(kPixels)) {
      hwy::Prefetch(at + kAhead);
      if constexpr (kLanes * texel_bytes(kPixels) > kLine) hwy::Prefetch(at + kAhead + kLine);
      add(at, [](VU fixed) HWY_ATTR { return fixed; });
    }
    if (const uint32_t rest = count % kLanes; rest != 0) {
      const PartOfRow<kPixels> part(at, 0, rest);
      const auto here = hn::RebindMask(kUints, first_pixels(rest));
      add(part.bytes, [&](VU fixed) HWY_ATTR { return hn::IfThenElse(here, fixed, offset); });
      ++vectors;
    }
    if (!notes.plain(max_luminance)) return false;
    sums.log2_sum = add_wide(sums.log2_sum, hn::Sub(log2_sum, hn::Set(kUints, vectors * kLog2Offset)));
    sums.max_luminance = hn::Max(sums.max_luminance, max_luminance);
    sums.min_luminance = hn::Min(sums.min_luminance, min_luminance);
    sums.max_light = hn::Max(sums.max_light, max_luminance);
    sums.alpha_differs |= !notes.opaque();
    return true;
  }
};

#endif  // CANDELA_HOST_TARGET

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
