// The objects of a view along a row, over the sky.
#if defined(CANDELA_HOST_VIEW_OBJECTS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_VIEW_OBJECTS_INL_H
#undef CANDELA_HOST_VIEW_OBJECTS_INL_H
#else
#define CANDELA_HOST_VIEW_OBJECTS_INL_H
#endif

#include <hwy/highway.h>

#include <limits>

#include "server/render/host/view/sky-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

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

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
