// The frame's light, up to exposure, as resolve and resize need it, for each target of Highway.
#if defined(CANDELA_HOST_LIGHT_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_LIGHT_INL_H
#undef CANDELA_HOST_LIGHT_INL_H
#else
#define CANDELA_HOST_LIGHT_INL_H
#endif

#include <hwy/aligned_allocator.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "server/render/host/lanes-inl.h"
#include "server/render/host/resolve.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// A part of a row that stays in the first cache while the stages of resolve pass over it.

using glsl::F;
using glsl::U;
using glsl::vec3;

inline constexpr uint32_t kChunk = 256;

// R, G, B and alpha of the pixels, register by register in the lanes' order. What is beyond the last
// pixel repeats it.
struct Chunk {
  HWY_ALIGN float c[4][kChunk];

  HWY_INLINE vec3 rgb(uint32_t i) const {
    return {hn::Load(kFloats, c[0] + i), hn::Load(kFloats, c[1] + i), hn::Load(kFloats, c[2] + i)};
  }
  HWY_INLINE F alpha(uint32_t i) const { return hn::Load(kFloats, c[3] + i); }
  HWY_INLINE void set_rgb(uint32_t i, const vec3& v) {
    hn::Store(v.r.v, kFloats, c[0] + i);
    hn::Store(v.g.v, kFloats, c[1] + i);
    hn::Store(v.b.v, kFloats, c[2] + i);
  }
  HWY_INLINE void set_alpha(uint32_t i, F a) { hn::Store(a.v, kFloats, c[3] + i); }
};

// Pixels x to x + count - 1 of row y; at most kChunk of them.
struct RowPart {
  const ResolveJob& job;
  uint32_t x;
  uint32_t y;
  uint32_t count;
  // The bloom of this row at x and beyond, at the level's width: see LightRow. Null without bloom.
  std::array<const float*, 3> light;
};

// A stage is a loop of its own over a chunk. So curves, transfers and formats need not multiply. It copies
// what it needs of the part before its loop: Highway's stores may alias anything, so the loop would read it
// each time.
using Stage = void (*)(const RowPart& part, Chunk& chunk);

// The bloom of the frame's rows, from level 0.

// A row of the bloom at the level's width, component by component, with the edge repeated on both sides.
class LightRow {
 public:
  explicit LightRow(const ResolveJob& job) : job_(job), pitch_(job.level.width + 2 * kPad) {
    if (job.constants.bloom == shader::BLOOM_NONE) return;
    floats_ = hwy::AllocateAligned<float>(3 * pitch_);
    std::fill_n(floats_.get(), 3 * pitch_, 0.0f);
    for (size_t k = 0; k < 3; ++k) rows_[k] = floats_.get() + k * pitch_ + kPad;
  }

  // Makes that of row y of the frame, for the pixels first <= x < last, scaled, so that pixels still have to
  // be interpolated along x. Without bloom it stays null.
  const std::array<float*, 3>& make(uint32_t y, uint32_t first, uint32_t last) {
    if (!floats_) return rows_;
    const uint32_t size = job_.constants.level_size;
    const int64_t nearer = y / size;
    const int64_t further = y % size < size / 2 ? nearer - 1 : nearer + 1;
    // The distance from the nearer row, in rows of the frame.
    const float away = std::abs(static_cast<float>(y % size) + 0.5f - 0.5f * static_cast<float>(size));
    const float part = away / static_cast<float>(size);
    const float scale = job_.params.bloom_scale * job_.params.exposure / static_cast<float>(2 * size);
    for (size_t k = 0; k < 3; ++k) {
      blend(row(nearer, k), row(further, k), scale * (1.0f - part), scale * part,
            first / size - std::min<uint32_t>(kPad, first / size),
            std::min<uint32_t>(last / size + 2 * kPad, job_.level.width), rows_[k]);
    }
    return rows_;
  }

 private:
  static constexpr size_t kPad = 16;  // what a register reads beyond either edge

  const float* row(int64_t y, size_t component) const {
    const auto last = static_cast<int64_t>(job_.level.height) - 1;
    return job_.level.row(static_cast<size_t>(std::clamp<int64_t>(y, 0, last)), component);
  }

  // Texels first <= x < last.
  HWY_NOINLINE void blend(const float* nearer, const float* further, float near_scale, float far_scale,
                          uint32_t first, uint32_t last, float* to) const {
    const VF a = set(near_scale);
    const VF b = set(far_scale);
    const uint32_t width = job_.level.width;
    const auto blended = [&](VF near_light, VF far_light)
                             HWY_ATTR { return hn::MulAdd(near_light, a, hn::Mul(far_light, b)); };
    uint32_t x = first;
    for (; x + kLanes <= last; x += kLanes) {
      hn::StoreU(blended(hn::LoadU(kFloats, nearer + x), hn::LoadU(kFloats, further + x)), kFloats, to + x);
    }
    if (x < last) {
      const size_t rest = last - x;
      hn::StoreU(blended(load_some(nearer + x, rest), load_some(further + x, rest)), kFloats, to + x);
    }
    to[-1] = to[0];
    to[width] = to[width - 1];
  }

  const ResolveJob& job_;
  const size_t pitch_;
  hwy::AlignedFreeUniquePtr<float[]> floats_;
  std::array<float*, 3> rows_ = {};
};

// Numbers for the interpolation along x: for each lane its texels, counted from the first one that any lane
// needs, and the weight of the nearer one. The further one has the rest of 2 * kSize.
template <uint32_t kSize>
struct AlongX {
  std::array<int32_t, kLanes> nearer{};
  std::array<int32_t, kLanes> further{};
  std::array<float, kLanes> weight{};

  constexpr AlongX() {
    for (uint32_t lane = 0; lane < kLanes; ++lane) {
      const uint32_t pixel = kPixelOfLane[lane];
      const uint32_t from_edge = 2 * (pixel % kSize) + 1;  // in half pixels
      nearer[lane] = static_cast<int32_t>(1 + pixel / kSize);
      further[lane] = nearer[lane] + (from_edge < kSize ? -1 : 1);
      weight[lane] = static_cast<float>(kSize + (from_edge < kSize ? from_edge : 2 * kSize - from_edge));
    }
  }
};

// The bloom of a register of pixels, of which the first has level texel from[1].
template <uint32_t kSize>
HWY_INLINE VF light_along_x(const float* from) {
  static constexpr AlongX<kSize> kAlong;
  const VF texels = hn::LoadU(kFloats, from);
  const VF nearer = hn::TableLookupLanes(texels, hn::SetTableIndices(kFloats, kAlong.nearer.data()));
  const VF further = hn::TableLookupLanes(texels, hn::SetTableIndices(kFloats, kAlong.further.data()));
  const VF weight = hn::LoadU(kFloats, kAlong.weight.data());
  const VF rest = hn::Sub(hn::Set(kFloats, 2.0f * kSize), weight);
  return hn::MulAdd(nearer, weight, hn::Mul(further, rest));
}

// Stages of resolve up to exposed light: the scene's pixels, bloom, exposure, and what of it is counted.

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
