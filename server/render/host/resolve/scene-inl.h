// Stages of resolve up to exposed light: the scene's pixels, bloom, exposure, and what of it is counted.
#if defined(CANDELA_HOST_SCENE_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_SCENE_INL_H
#undef CANDELA_HOST_SCENE_INL_H
#else
#define CANDELA_HOST_SCENE_INL_H
#endif

#include <hwy/highway.h>

#include "server/render/host/resolve/light_row-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// Calls use(i, pixels) for each register of the part's pixels, as they are on the wire.
template <uint32_t kPixels, typename Use>
HWY_INLINE void load_each(const RowPart& part, const Use& use) {
  constexpr size_t kBytes = texel_bytes(kPixels);
  const size_t first = size_t{part.y} * part.job.params.frame.input_pitch + part.x;
  const std::byte* const wire = part.job.wire + first * kBytes;
  const uint32_t count = part.count;
  uint32_t i = 0;
  for (; i + kLanes <= count; i += kLanes) use(i, load_pixels<kPixels>(wire + i * kBytes));
  if (i < count) use(i, load_pixels<kPixels>(PartOfRow<kPixels>(wire, i, count).bytes));
}

// Scene pixels from those of the wire. kExact: they need neither scrub nor matrix nor rounding.
template <uint32_t kPixels, bool kExact>
HWY_NOINLINE void load_scene(const RowPart& part, Chunk& chunk) {
  const shader::ResolveConstants& constants = part.job.constants;
  const Input input = {part.job.params.frame, kPixels, constants.matrix != 0, constants.scrub != 0};
  const bool wide = constants.wide != 0;
  const bool unrounded = constants.unrounded != 0;
  load_each<kPixels>(part, [&](uint32_t i, Pixels c) HWY_ATTR {
    if constexpr (!kExact) {
      c = unrounded ? ingest_unrounded(input, c) : wide ? ingest_wide(input, c) : ingest(input, c);
    }
    chunk.set_rgb(i, {c.r, c.g, c.b});
    chunk.set_alpha(i, c.a);
  });
}

// What the scene is multiplied by: the exposure, and with CONSERVE also the part that bloom leaves.
HWY_INLINE F scene_factor(const ResolveJob& job) {
  const shader::ResolveParams& p = job.params;
  return job.constants.bloom == shader::BLOOM_CONSERVE ? p.scene_scale * p.exposure : p.exposure;
}

// Scene pixels `c`, those from i on of a part, times `scene`, with the part's bloom: exposed light. kSize:
// frame pixels to a bloom texel along a side; 0 without bloom.
template <uint32_t kSize>
HWY_INLINE vec3 exposed(const vec3& c, F scene, const std::array<const float*, 3>& light, uint32_t i) {
  if constexpr (kSize == 0) {
    return {F(c.r * scene), F(c.g * scene), F(c.b * scene)};
  } else {
    const size_t at = i / kSize;
    return {c.r * scene + F(light_along_x<kSize>(light[0] + at - 1)),
            c.g * scene + F(light_along_x<kSize>(light[1] + at - 1)),
            c.b * scene + F(light_along_x<kSize>(light[2] + at - 1))};
  }
}

// Bloom, background and exposure. The light is cut to where every curve is flat.
template <uint32_t kSize>
HWY_NOINLINE void expose(const RowPart& part, Chunk& chunk) {
  const shader::ResolveConstants& constants = part.job.constants;
  const shader::ResolveParams& p = part.job.params;
  const F scene = scene_factor(part.job);
  const std::array<const float*, 3> light = part.light;
  const F most = shader::MAX_EXPOSED_VALUE;
  const bool wide = constants.wide != 0;  // only then is light negative
  const bool over = constants.alpha == shader::ALPHA_OVER;
  const vec3 background = {F(p.background_r * p.exposure), F(p.background_g * p.exposure),
                           F(p.background_b * p.exposure)};
  const uint32_t count = part.count;
  for (uint32_t i = 0; i < count; i += kLanes) {
    vec3 c = exposed<kSize>(chunk.rgb(i), scene, light, i);
    if (over) {
      const F rest = 1.0 - min(max(chunk.alpha(i), 0.0), 1.0);
      c = {rest * background.r + c.r, rest * background.g + c.g, rest * background.b + c.b};
    }
    if (wide) c = at_least(c, -shader::MAX_EXPOSED_VALUE);
    chunk.set_rgb(i, at_most(c, most));
  }
}

// Opaque halves that need neither matrix nor scrub, and light that needs no cut: none is negative, the scene
// is below 2^16, and bloom is at most ten times that.
inline bool is_usual(const ResolveJob& job) {
  const shader::ResolveConstants& c = job.constants;
  return job.opaque && job.gain == nullptr && c.pixels == shader::PIXELS_RGBA16F && c.matrix == 0 &&
         c.scrub == 0 && c.wide == 0 && job.params.exposure <= 0x1p32f;
}

// load_scene() and expose() in one loop, for what is_usual(). It leaves alpha as it is.
template <uint32_t kSize>
HWY_NOINLINE void load_exposed(const RowPart& part, Chunk& chunk) {
  const F scene = scene_factor(part.job);
  const std::array<const float*, 3> light = part.light;
  load_each<shader::PIXELS_RGBA16F>(part, [&](uint32_t i, const Pixels& c) HWY_ATTR {
    chunk.set_rgb(i, exposed<kSize>({c.r, c.g, c.b}, scene, light, i));
  });
}

// Alpha as the curve's stages and the output take it: clamped for straight alpha, 1 where it is not kept.
HWY_NOINLINE inline void settle_alpha(const RowPart& part, Chunk& chunk) {
  const bool straight = part.job.constants.alpha == shader::ALPHA_STRAIGHT;
  const uint32_t count = part.count;
  for (uint32_t i = 0; i < count; i += kLanes) {
    chunk.set_alpha(i, straight ? min(max(chunk.alpha(i), 0.0), 1.0) : F(1.0));
  }
}

inline Stage load_exposed_stage(const shader::ResolveConstants& constants) {
  if (constants.bloom == shader::BLOOM_NONE) return load_exposed<0>;
  return constants.level_size == 4 ? load_exposed<4> : load_exposed<2>;
}

inline Stage load_stage(const shader::ResolveConstants& constants) {
  const bool exact = constants.matrix == 0 && constants.scrub == 0;
  switch (constants.pixels) {
    case shader::PIXELS_RGBA32F:
      return load_scene<shader::PIXELS_RGBA32F, false>;
    case shader::PIXELS_SCENE:
      return load_scene<shader::PIXELS_RGBA32F, true>;
    case shader::PIXELS_RGB9E5:
      return exact ? load_scene<shader::PIXELS_RGB9E5, true> : load_scene<shader::PIXELS_RGB9E5, false>;
    default:
      return exact ? load_scene<shader::PIXELS_RGBA16F, true> : load_scene<shader::PIXELS_RGBA16F, false>;
  }
}

inline Stage expose_stage(const shader::ResolveConstants& constants) {
  if (constants.bloom == shader::BLOOM_NONE) return expose<0>;
  return constants.level_size == 4 ? expose<4> : expose<2>;
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
