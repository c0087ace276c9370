// Views of cube maps on the host, for each target of Highway.
#include "server/render/host/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/view.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <hwy/highway.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "server/render/host/view.h"

#if CANDELA_HOST_TARGET
#include "server/render/host/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// The shader's own text about cubes and views.

using glsl::B;
using glsl::F;
using glsl::I;
using glsl::U;
using glsl::vec3;

// The shared files stand between two files of macros.
// clang-format off
namespace shared {
using namespace glsl;    // NOLINT: GLSL has no namespaces
using namespace shader;  // NOLINT

struct Cube {
#include "server/render/host/glsl-begin.h"
#include "shaders/glsl/cube.glsl"
#include "server/render/host/glsl-end.h"
};

struct View {
  // A copy, which stores into a frame cannot change.
  const ViewParams p;
  explicit View(const ViewParams& params) : p(params) {}
  HWY_INLINE F log2(F x) { return exact_log2(x); }
#include "server/render/host/glsl-begin.h"
#include "shaders/glsl/log2.glsl"
#include "shaders/glsl/view.glsl"
#include "server/render/host/glsl-end.h"
};
}  // namespace shared
// clang-format on

using shared::Cube;
using CubePlace = Cube::CubePlace;

// Look-ups in the levels of a cube map, a register of pixels at a time.
//
// A texel is four floats, so two that lie side by side are one load. A look-up is linear first down and then
// across, on whole texels, because gathers of single words are dearer. Lanes are in the order of the row.

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

// The sky of a view along a row.

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

// The objects of a view along a row, over the sky.

// Draws a register of pixels at a time. What a lane computes does not depend on the others.
class Objects {
 public:
  Objects(const ViewJob& job, const ViewPart& part)
      : job_(job), part_(part), view_(job.params), chain_(chain_of(job)) {}

  // Draws the pixels that show not only the sky, of the `count` ones from x on.
  HWY_FLATTEN void draw(uint32_t x, uint32_t y, uint32_t count) {
    const Corner corner = {F(x) + lane_columns(), F(y)};
    const vec3 middle = view_.ray(corner.x + 0.5f, corner.y + 0.5f);
    const Found centre = object_at(middle);
    const uint32_t side = job_.params.samples_side;
    B mixed = {hn::MaskFromVec(hn::Zero(kFloats))};
    for (uint32_t k = 0; side > 1 && k < side * side; ++k) {
      mixed = mixed || !(object_at(grid_ray(corner, k)).object == centre.object);
    }
    const uint32_t wanted = (1u << count) - 1;
    const uint32_t is_mixed = bits_of(mixed) & wanted;
    const uint32_t is_whole = bits_of(!(centre.object == I(kSky))) & wanted & ~is_mixed;
    if ((is_mixed | is_whole) == 0) return;
    vec3 c = light(middle, centre, is_whole);
    if (is_mixed != 0) c = mix(c, grid_light(corner, is_mixed), glsl::bvec3(mixed, mixed, mixed));
    std::byte* const to = job_.pixels + (size_t{y} * job_.params.pitch + x) * pixel_bytes(job_.floats);
    job_.floats ? store_floats(c, is_mixed | is_whole, to) : store_halves(c, is_mixed | is_whole, to);
  }

 private:
  static constexpr int32_t kSky = -1;

  // The upper left corners of pixels.
  struct Corner {
    F x, y;
  };
  // The object that a ray meets first, or kSky, and how many times d it is away.
  struct Found {
    I object;
    F away;
  };

  // Ray k of the grid in the pixels.
  HWY_INLINE vec3 grid_ray(const Corner& corner, uint32_t k) {
    const uint32_t side = job_.params.samples_side;
    const float step = 1.0f / static_cast<float>(side);
    return view_.ray(corner.x + (static_cast<float>(k % side) + 0.5f) * step,
                     corner.y + (static_cast<float>(k / side) + 0.5f) * step);
  }

  HWY_INLINE Found object_at(const vec3& d) {
    Found found = {I(kSky), F(std::numeric_limits<float>::infinity())};
    const F length2 = view_.squared(d);
    for (uint32_t k = part_.first_object; k < part_.end_object; ++k) {
      const shader::ViewObject& o = job_.objects[k];
      const auto meeting = view_.meeting_of({o.ox, o.oy, o.oz}, o.radius_squared, o.to_surface, d, length2);
      const B nearer = meeting.hit && meeting.away < found.away;
      found = {mix(found.object, I(k), nearer), mix(found.away, meeting.away, nearer)};
    }
    return found;
  }

  // What the lanes `wanted` see, object after object.
  HWY_INLINE vec3 light(const vec3& d, const Found& found, uint32_t wanted) {
    HWY_ALIGN int32_t objects[kLanes];
    hn::Store(found.object.v, kInts, objects);
    vec3 c = vec3(F(0.0f));
    while (wanted != 0) {
      const size_t first = hwy::Num0BitsBelowLS1Bit_Nonzero32(wanted);
      const B here = found.object == I(objects[first]);
      wanted &= ~bits_of(here);
      // The other lanes do as the first one does, so that they find something.
      const glsl::bvec3 which = {here, here, here};
      const vec3 ray = mix(vec3(lane(d.r, first), lane(d.g, first), lane(d.b, first)), d, which);
      const F away = mix(lane(found.away, first), found.away, here);
      c = mix(c,
              objects[first] == kSky ? sky_light(ray) : object_light(job_.objects[objects[first]], ray, away),
              which);
    }
    return c;
  }

  // One lane for all.
  static HWY_INLINE F lane(F x, size_t i) {
    HWY_ALIGN float lanes[kLanes];
    hn::Store(x.v, kFloats, lanes);
    return lanes[i];
  }

  HWY_INLINE vec3 chain_light(const CubePlace& place, F lod) const {
    ChainSpots<kLanes> spots;
    TexelLanes lanes;
    if (chain_.find(place, lod, 0, spots)) {
      for (size_t i = 0; i < kLanes; ++i) lanes.set(i, spots.near.texel(chain_.texels, i));
    } else {
      for (size_t i = 0; i < kLanes; ++i) lanes.set(i, spots.texel(chain_.texels, i));
    }
    return lanes.rgb();
  }

  HWY_INLINE vec3 specular_light(uint32_t start, uint32_t size, const CubePlace& place) const {
    Spots<kLanes> spots;
    spots.set(0, spot_in(start, size, place));
    TexelLanes lanes;
    for (size_t i = 0; i < kLanes; ++i) lanes.set(i, spots.texel(job_.specular, i));
    return lanes.rgb();
  }

  HWY_NOINLINE HWY_FLATTEN vec3 sky_light(const vec3& d) {
    const CubePlace place = Cube().cube_place(view_.turned(d));
    return chain_light(place, view_.lod_of(place.size));
  }

  HWY_NOINLINE HWY_FLATTEN vec3 object_light(const shader::ViewObject& o, const vec3& d, F away) {
    const auto surface = view_.surface_at({o.ox, o.oy, o.oz}, o.inverse_radius, d, away);
    const CubePlace place = Cube().cube_place(view_.turned(surface.mirrored));
    vec3 reflected = vec3(F(0.0f));
    if (o.chain_weight != 0) {
      const F lod = view_.lod_of(place.size * surface.size) + surface.spread;
      reflected = F(o.chain_weight) * chain_light(place, lod);
    }
    if (o.near_weight != 0) {
      reflected = reflected + F(o.near_weight) * specular_light(o.near_start, o.near_size, place);
    }
    if (o.far_weight != 0) {
      reflected = reflected + F(o.far_weight) * specular_light(o.far_start, o.far_size, place);
    }
    const F column = view_.brdf_column(surface.nov);
    const F left = floor(column);
    const glsl::utextureBuffer table = {reinterpret_cast<const uint32_t*>(o.brdf), shader::BRDF_SIZE};
    const glsl::uvec4 pairs = texelFetch(table, I(left));
    const F scale = mix(uintBitsToFloat(pairs.rgb.r), uintBitsToFloat(pairs.rgb.b), column - left);
    const F bias = mix(uintBitsToFloat(pairs.rgb.g), uintBitsToFloat(pairs.a), column - left);
    return view_.light_of_surface(reflected, irradiance(view_.turned(surface.n)), {o.f0_r, o.f0_g, o.f0_b},
                                  {o.diffuse_r, o.diffuse_g, o.diffuse_b}, scale, bias);
  }

  // Irr(n), for a unit direction in the environment's axes.
  HWY_INLINE vec3 irradiance(const vec3& n) {
    const auto factors = view_.harmonic_factors(n);
    vec3 sum = vec3(F(0.0f));
    for (size_t i = 0; i < 9; ++i) {
      const float* const c = job_.light.irradiance + 4 * i;
      sum = sum + factors.of[i] * vec3(c[0], c[1], c[2]);
    }
    return {max(sum.r, 0.0f), max(sum.g, 0.0f), max(sum.b, 0.0f)};
  }

  // The mean over the grid, where `wanted`.
  HWY_INLINE vec3 grid_light(const Corner& corner, uint32_t wanted) {
    const uint32_t rays = job_.params.samples_side * job_.params.samples_side;
    vec3 sum = vec3(F(0.0f));
    for (uint32_t k = 0; k < rays; ++k) {
      const vec3 d = grid_ray(corner, k);
      sum = sum + light(d, object_at(d), wanted);
    }
    return sum / F(rays);
  }

  // Stores the lanes `drawn`.
  static HWY_INLINE void store_floats(const vec3& c, uint32_t drawn, std::byte* to) {
    const auto cut = [](F x) HWY_ATTR { return clamp_to(shader::MAX_LIGHT, x.v); };
    HWY_ALIGN float pixels[4 * kLanes];
    hn::StoreInterleaved4(cut(c.r), cut(c.g), cut(c.b), set(1.0f), kFloats, pixels);
    copy_drawn(drawn, reinterpret_cast<const std::byte*>(pixels), pixel_bytes(true), to);
  }
  static HWY_INLINE void store_halves(const vec3& c, uint32_t drawn, std::byte* to) {
    const hn::Rebind<hwy::float16_t, DF> halves;
    const hn::Rebind<uint16_t, DF> bits;
    const auto half = [&](F x)
                          HWY_ATTR { return hn::BitCast(bits, hn::DemoteTo(halves, clamp_to_half(x.v))); };
    HWY_ALIGN uint16_t pixels[4 * kLanes];
    hn::StoreInterleaved4(half(c.r), half(c.g), half(c.b), half(1.0f), bits, pixels);
    copy_drawn(drawn, reinterpret_cast<const std::byte*>(pixels), pixel_bytes(false), to);
  }
  static HWY_INLINE void copy_drawn(uint32_t drawn, const std::byte* pixels, size_t bytes, std::byte* to) {
    for (; drawn != 0; drawn &= drawn - 1) {
      const size_t i = hwy::Num0BitsBelowLS1Bit_Nonzero32(drawn);
      std::memcpy(to + i * bytes, pixels + i * bytes, bytes);
    }
  }

  const ViewJob& job_;
  const ViewPart& part_;
  shared::View view_;
  const Chain chain_;
};

void draw_part(const ViewJob& job, const ViewPart& part, uint32_t y) {
  const uint32_t x1 = std::min(part.x1, job.params.width);
  if (!part.objects) return job.floats ? draw_sky<true>(job, part, x1, y) : draw_sky<false>(job, part, x1, y);
  Objects objects(job, part);
  for (uint32_t x = part.x0; x < x1; x += kLanes) objects.draw(x, y, std::min<uint32_t>(x1 - x, kLanes));
}

void draw_rows(const ViewJob& job, std::span<const ViewPart> parts, uint32_t y0, uint32_t y1) {
  for (uint32_t y = y0; y < y1; ++y) {
    for (const ViewPart& part : parts) draw_part(job, part, y);
  }
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#else

namespace candela::host::HWY_NAMESPACE {
void draw_rows(const ViewJob&, std::span<const ViewPart>, uint32_t, uint32_t) {}
}  // namespace candela::host::HWY_NAMESPACE

#endif

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(draw_rows);

void draw_view_rows(const ViewJob& job, std::span<const ViewPart> parts, uint32_t y0, uint32_t y1) {
  HWY_DYNAMIC_DISPATCH(draw_rows)(job, parts, y0, y1);
}

}  // namespace candela::host
#endif
