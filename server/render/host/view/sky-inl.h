// The sky of a view along a row.
#if defined(CANDELA_HOST_VIEW_SKY_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_VIEW_SKY_INL_H
#undef CANDELA_HOST_VIEW_SKY_INL_H
#else
#define CANDELA_HOST_VIEW_SKY_INL_H
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cstring>

#include "server/render/host/view/levels-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

constexpr size_t pixel_bytes(bool floats) { return floats ? 16 : 8; }

// 0, 1, 2 ...: the columns of the lanes.
HWY_INLINE F lane_columns() { return hn::Iota(kFloats, 0); }

HWY_INLINE Chain chain_of(const ViewJob& job) {
  return {job.chain, job.params.chain_size, job.params.chain_last};
}

// Pixels of a row that are made together: first all of their spots, then all of their texels.
constexpr uint32_t kSkyChunk = 256;

// The directions of a row's pixels, in the environment's axes.
class RowOfRays {
 public:
  HWY_INLINE RowOfRays(shared::View& view, uint32_t y)
      : along_(view.turned({view.p.pixel, 0.0f, 0.0f})),
        middle_(view.turned(view.ray(0.5 * F(view.p.width), F(y) + 0.5f))),
        to_middle_(lane_columns() + (0.5f - 0.5f * static_cast<float>(view.p.width))) {}

  // Those from column x on.
  HWY_INLINE vec3 at(uint32_t x) const { return middle_ + (F(x) + to_middle_) * along_; }

 private:
  const vec3 along_;
  const vec3 middle_;
  const F to_middle_;
};

template <typename D>
HWY_INLINE void store_as_halves(D d, hn::Vec<D> v, std::byte* to) {
  const hn::Rebind<hwy::float16_t, D> halves;
  const hn::Rebind<uint16_t, D> bits;
  hn::StoreU(hn::BitCast(bits, hn::DemoteTo(halves, v)), bits, reinterpret_cast<uint16_t*>(to));
}

template <typename D>
HWY_INLINE void store_two(D d, VTexel a, VTexel b, std::byte* to) {
  if constexpr (hn::MaxLanes(D()) == 8) {
    store_as_halves(d, hn::Combine(d, b, a), to);
  } else {
    store_as_halves(d, a, to);
    store_as_halves(d, b, to + pixel_bytes(false));
  }
}

// Stores texel(i) for first <= i < last.
template <bool kToFloats, typename Texel>
HWY_INLINE void store_texels(uint32_t first, uint32_t last, std::byte* to, const Texel& texel) {
  constexpr size_t kBytes = pixel_bytes(kToFloats);
  uint32_t i = first;
  if constexpr (kToFloats) {
    for (; i < last; ++i) hn::StoreU(texel(i), kTexel, reinterpret_cast<float*>(to + i * kBytes));
  } else {
    for (; i + 4 <= last; i += 4) {
      store_two(kTexels, texel(i), texel(i + 1), to + i * kBytes);
      store_two(kTexels, texel(i + 2), texel(i + 3), to + (i + 2) * kBytes);
    }
    for (; i < last; ++i) store_as_halves(kTexel, texel(i), to + i * kBytes);
  }
}

// A sky that is level 0 alone.
HWY_NOINLINE HWY_FLATTEN inline void find_magnified(const ViewJob& job, uint32_t x, uint32_t count,
                                                    uint32_t y, Spots<kSkyChunk>& spots) {
  shared::View view(job.params);
  const RowOfRays rays(view, y);
  const Chain chain = chain_of(job);
  for (uint32_t i = 0; i < count; i += kLanes) spots.set(i, chain.spot(0, Cube().cube_place(rays.at(x + i))));
}

template <bool kToFloats>
HWY_NOINLINE HWY_FLATTEN void draw_magnified(const ViewJob& job, const Spots<kSkyChunk>& spots,
                                             uint32_t count, std::byte* to) {
  const float* const chain = job.chain;
  const size_t pitch = size_t{4} * (job.params.chain_size + 2);
  store_texels<kToFloats>(0, count, to, [&](uint32_t i) HWY_ATTR { return spots.texel(chain, i, pitch); });
}

// A sky between levels. `one_level` is for each register of pixels.
struct SkySpots {
  ChainSpots<kSkyChunk> spots;
  bool one_level[kSkyChunk / kLanes];
};

HWY_NOINLINE HWY_FLATTEN inline void find_between(const ViewJob& job, uint32_t x, uint32_t count, uint32_t y,
                                                  SkySpots& sky) {
  shared::View view(job.params);
  const RowOfRays rays(view, y);
  const Chain chain = chain_of(job);
  for (uint32_t i = 0; i < count; i += kLanes) {
    const CubePlace place = Cube().cube_place(rays.at(x + i));
    sky.one_level[i / kLanes] = chain.find(place, view.lod_of(place.size), i, sky.spots);
  }
}

template <bool kToFloats>
HWY_NOINLINE HWY_FLATTEN void draw_between(const ViewJob& job, const SkySpots& sky, uint32_t count,
                                           std::byte* to) {
  const float* const chain = job.chain;
  for (uint32_t i = 0; i < count; i += kLanes) {
    const uint32_t end = std::min<uint32_t>(count, i + kLanes);
    if (sky.one_level[i / kLanes]) {
      store_texels<kToFloats>(i, end, to,
                              [&](uint32_t k) HWY_ATTR { return sky.spots.near.texel(chain, k); });
    } else {
      store_texels<kToFloats>(i, end, to, [&](uint32_t k) HWY_ATTR { return sky.spots.texel(chain, k); });
    }
  }
}

// Columns x0 to x1 - 1 of row y. A mean of texels needs no clamp.
template <bool kToFloats>
void draw_sky(const ViewJob& job, const ViewPart& part, uint32_t x1, uint32_t y) {
  constexpr size_t kBytes = pixel_bytes(kToFloats);
  std::byte* const row = job.pixels + size_t{y} * job.params.pitch * kBytes;
  SkySpots sky;
  for (uint32_t x = part.x0; x < x1; x += kSkyChunk) {
    const uint32_t count = std::min(x1 - x, kSkyChunk);
    if (part.magnified) {
      find_magnified(job, x, count, y, sky.spots.near);
      draw_magnified<kToFloats>(job, sky.spots.near, count, row + x * kBytes);
    } else {
      find_between(job, x, count, y, sky);
      draw_between<kToFloats>(job, sky, count, row + x * kBytes);
    }
  }
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
