// Look-ups in the levels of a cube map, a register of pixels at a time.
//
// A texel is four floats, so two that lie side by side are one load. A look-up is linear first down and then
// across, on whole texels, because gathers of single words are dearer. Lanes are in the order of the row.
#if defined(CANDELA_HOST_VIEW_LEVELS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_VIEW_LEVELS_INL_H
#undef CANDELA_HOST_VIEW_LEVELS_INL_H
#else
#define CANDELA_HOST_VIEW_LEVELS_INL_H
#endif

#include <hwy/highway.h>

#include "server/render/host/view/text-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// A texel, and two of them where a register holds as many.
using DTexel = hn::FixedTag<float, 4>;
using DTexels = hn::CappedTag<float, 8>;
using VTexel = hn::Vec<DTexel>;
inline constexpr DTexel kTexel;
inline constexpr DTexels kTexels;

// The lanes of a condition as bits.
HWY_INLINE uint32_t bits_of(B condition) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(kFloats, condition.m, bytes);
  return bytes[0] | static_cast<uint32_t>(bytes[1]) << 8;
}

// Stored texels with alpha 1: their fourth float is something else.
template <typename D>
HWY_INLINE hn::Vec<D> load_opaque(D d, const float* at) {
  HWY_ALIGN static constexpr uint32_t kRgb[8] = {~0u, ~0u, ~0u, 0, ~0u, ~0u, ~0u, 0};
  const auto rgb = hn::MaskFromVec(hn::BitCast(d, hn::Load(hn::RebindToUnsigned<D>(), kRgb)));
  return hn::IfThenElse(rgb, hn::LoadU(d, at), hn::Set(d, 1.0f));
}

template <typename D>
HWY_INLINE hn::Vec<D> between(D d, hn::Vec<D> a, hn::Vec<D> b, float part) {
  return hn::MulAdd(hn::Set(d, part), hn::Sub(b, a), a);
}

// The texel between those at `above` and `below` and their neighbours.
template <typename D>
HWY_INLINE VTexel bilinear(D d, const float* above, const float* below, float across, float down) {
  if constexpr (hn::MaxLanes(D()) == 8) {
    const auto both = between(d, load_opaque(d, above), load_opaque(d, below), down);
    return between(kTexel, hn::LowerHalf(kTexel, both), hn::UpperHalf(kTexel, both), across);
  } else {
    const VTexel left = between(d, load_opaque(d, above), load_opaque(d, below), down);
    const VTexel right = between(d, load_opaque(d, above + 4), load_opaque(d, below + 4), down);
    return between(d, left, right, across);
  }
}

// Where the lanes look up texels: the upper left one and the step to the next row, in floats, and the
// weights.
struct Spot {
  U at;
  U pitch;
  F across;
  F down;
};

HWY_INLINE Spot mix(const Spot& a, const Spot& b, B which) {
  return {mix(a.at, b.at, which), mix(a.pitch, b.pitch, which), mix(a.across, b.across, which),
          mix(a.down, b.down, which)};
}

// In the level of `size` that begins at texel `start`.
HWY_INLINE Spot spot_in(uint32_t start, uint32_t size, const CubePlace& place) {
  const auto spot = Cube().cube_spot(start, size, place);
  const uint32_t pitch = size + 2;
  // Only what is not finite would lie beyond the last one.
  const U last = start + 6 * pitch * pitch - pitch - 2;
  return {min(spot.at, last) << 2, pitch << 2, spot.across, spot.down};
}

// The spots of kCount pixels.
template <size_t kCount>
class Spots {
 public:
  HWY_INLINE void set(size_t i, const Spot& spot) {
    hn::Store(spot.at.v, kUints, at_ + i);
    hn::Store(spot.pitch.v, kUints, pitch_ + i);
    hn::Store(spot.across.v, kFloats, across_ + i);
    hn::Store(spot.down.v, kFloats, down_ + i);
  }
  HWY_INLINE VTexel texel(const float* levels, size_t i) const { return texel(levels, i, pitch_[i]); }
  HWY_INLINE VTexel texel(const float* levels, size_t i, size_t pitch) const {
    const float* const above = levels + at_[i];
    return bilinear(kTexels, above, above + pitch, across_[i], down_[i]);
  }

 private:
  HWY_ALIGN uint32_t at_[kCount];
  HWY_ALIGN uint32_t pitch_[kCount];
  HWY_ALIGN float across_[kCount];
  HWY_ALIGN float down_[kCount];
};

// The spots of kCount pixels in two levels each, and what counts of the second.
template <size_t kCount>
struct ChainSpots {
  Spots<kCount> near;
  Spots<kCount> far;
  HWY_ALIGN float part[kCount];

  HWY_INLINE VTexel texel(const float* chain, size_t i) const {
    return between(kTexel, near.texel(chain, i), far.texel(chain, i), part[i]);
  }
};

// A chain of levels, bilinear in each and linear between two.
struct Chain {
  const float* texels;
  uint32_t size;
  uint32_t last;

  HWY_INLINE Spot spot(uint32_t level, const CubePlace& place) const {
    const uint32_t n = size >> level;
    return spot_in(CUBE_LEVEL_START(size, n, level), n, place);
  }

  // Sets the spots of a register of pixels, which mostly read the same levels. Returns whether they read one
  // level alone.
  template <size_t kCount>
  HWY_INLINE bool find(const CubePlace& place, F lod, size_t i, ChainSpots<kCount>& spots) const {
    const F level = clamp(lod, 0.0f, static_cast<float>(last));
    const I fine(level);
    const F part = level - F(fine);
    uint32_t now = static_cast<uint32_t>(hn::GetLane(fine.v));
    Spot near = spot(now, place);
    Spot far = spot(std::min(now + 1, last), place);
    uint32_t others = bits_of(!(fine == I(now)));
    while (others != 0) {
      HWY_ALIGN uint32_t levels[kLanes];
      hn::Store(U(fine).v, kUints, levels);
      now = levels[hwy::Num0BitsBelowLS1Bit_Nonzero32(others)];
      const B here = fine == I(now);
      near = mix(near, spot(now, place), here);
      far = mix(far, spot(std::min(now + 1, last), place), here);
      others &= ~bits_of(here);
    }
    spots.near.set(i, near);
    spots.far.set(i, far);
    hn::Store(part.v, kFloats, spots.part + i);
    return hn::AllTrue(kFloats, (part == F(0.0f)).m);
  }
};

// R, G and B of the lanes' texels.
class TexelLanes {
 public:
  HWY_INLINE void set(size_t lane, VTexel texel) { hn::Store(texel, kTexel, texels_ + 4 * lane); }
  HWY_INLINE vec3 rgb() const {
    static constexpr auto kOrder = [] {
      std::array<uint32_t, kLanes> order{};
      for (uint32_t i = 0; i < kLanes; ++i) order[i] = i;
      return order;
    }();
    return uintBitsToFloat(
        glsl::transposed_elements(reinterpret_cast<const uint32_t*>(texels_), kOrder.data()).rgb);
  }

 private:
  HWY_ALIGN float texels_[4 * kLanes];
};

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
