// ACES 2.0 on the host: the shaders' own text, except for its powers. For each target of Highway.
//
// Each step is a loop of its own over the chunk. In one loop, each pixel would wait for a chain of operations
// that is longer than what the processor looks ahead.
#if defined(CANDELA_HOST_ACES2_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_ACES2_INL_H
#undef CANDELA_HOST_ACES2_INL_H
#else
#define CANDELA_HOST_ACES2_INL_H
#endif

#include <hwy/highway.h>

#include "server/render/host/resolve/aces2_powers-inl.h"
#include "server/render/host/resolve/chunk-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// clang-format off
namespace shared {
using namespace glsl;    // NOLINT: GLSL has no namespaces
using namespace shader;  // NOLINT

struct Aces2 : Aces2Powers {
  const utextureBuffer table_points;
  explicit Aces2(const ResolveJob& job) : table_points{job.table, job.table_points} { load_aces2(); }
#include "server/render/host/lanes/glsl-begin.h"
#include "shaders/glsl/log2.glsl"
#include "shaders/glsl/aces2.glsl"
#include "server/render/host/lanes/glsl-end.h"
};
}  // namespace shared
// clang-format on

using shared::Aces2;

// What the steps hand on, for each pixel of a chunk.
struct Aces2Chunk {
  HWY_ALIGN float j[kChunk], m[kChunk], c[kChunk], s[kChunk], place[kChunk], response[kChunk];
  Chunk hues;
  Chunk lines;

  HWY_INLINE Aces2::Aces2Colour colour(uint32_t i) const {
    const auto at = [i](const float* from) HWY_ATTR { return F(hn::Load(kFloats, from + i)); };
    return {at(j), at(m), at(c), at(s), at(place)};
  }
  HWY_INLINE Aces2::Aces2Hue hue(uint32_t i) const { return {hues.rgb(i), hues.alpha(i)}; }
  HWY_INLINE void set_lightness(uint32_t i, const Aces2::Aces2Colour& colour) {
    hn::Store(colour.j.v, kFloats, j + i);
    hn::Store(colour.m.v, kFloats, m + i);
  }
  HWY_INLINE void set(uint32_t i, const Aces2::Aces2Colour& colour) {
    set_lightness(i, colour);
    hn::Store(colour.c.v, kFloats, c + i);
    hn::Store(colour.s.v, kFloats, s + i);
    hn::Store(colour.place.v, kFloats, place + i);
  }
};

// Everything that a step calls is inlined into its loop.
#define CANDELA_ACES2_STEP HWY_NOINLINE HWY_FLATTEN inline void

CANDELA_ACES2_STEP aces2_see(Aces2 look, bool wide, uint32_t count, Chunk& light) {
  static constexpr float kToAp1[] = {TABLE_FROM_SCENE_AP1};
  for (uint32_t i = 0; i < count; i += kLanes) {
    const vec3 x = light.rgb(i);
    const auto row = [&](const float* m)
                         HWY_ATTR { return F((F(m[0]) * x.r + F(m[1]) * x.g) + F(m[2]) * x.b); };
    const vec3 ap1 = {row(kToAp1), row(kToAp1 + 3), row(kToAp1 + 6)};
    light.set_rgb(i, look.aces2_aab(wide ? at_least(ap1, 0.0) : ap1));
  }
}
CANDELA_ACES2_STEP aces2_turn(Aces2 look, uint32_t count, const Chunk& aab, Aces2Chunk& colours) {
  for (uint32_t i = 0; i < count; i += kLanes) colours.set(i, look.aces2_seen(aab.rgb(i)));
}
CANDELA_ACES2_STEP aces2_look_up(Aces2 look, uint32_t count, Aces2Chunk& colours) {
  for (uint32_t i = 0; i < count; i += kLanes) {
    const Aces2::Aces2Hue hue = look.aces2_hue(hn::Load(kFloats, colours.place + i));
    colours.hues.set_rgb(i, hue.cusp);
    colours.hues.set_alpha(i, hue.reach);
    hn::Store(look.aces2_tone(hn::Load(kFloats, colours.j + i)).v, kFloats, colours.response + i);
  }
}
CANDELA_ACES2_STEP aces2_tone(Aces2 look, uint32_t count, Aces2Chunk& colours) {
  for (uint32_t i = 0; i < count; i += kLanes) {
    colours.set_lightness(i, look.aces2_toned(colours.colour(i), hn::Load(kFloats, colours.response + i),
                                              colours.hue(i).reach));
  }
}
HWY_INLINE bool all_well_inside(Aces2& look, const Aces2::Aces2Colour& colour, const Aces2::Aces2Hue& hue) {
  return hn::AllTrue(kFloats, look.aces2_well_inside(colour, hue).m);
}
CANDELA_ACES2_STEP aces2_draw_lines(Aces2 look, uint32_t count, Aces2Chunk& colours) {
  for (uint32_t i = 0; i < count; i += kLanes) {
    const Aces2::Aces2Colour colour = colours.colour(i);
    const Aces2::Aces2Hue hue = colours.hue(i);
    if (all_well_inside(look, colour, hue)) continue;
    const Aces2::Aces2Line line = look.aces2_line(colour, hue);
    colours.lines.set_rgb(i, {line.source, line.cusp_source, line.slope});
  }
}
CANDELA_ACES2_STEP aces2_fit(Aces2 look, uint32_t count, Aces2Chunk& colours) {
  for (uint32_t i = 0; i < count; i += kLanes) {
    const Aces2::Aces2Colour colour = colours.colour(i);
    const Aces2::Aces2Hue hue = colours.hue(i);
    if (all_well_inside(look, colour, hue)) continue;
    const vec3 line = colours.lines.rgb(i);
    colours.set_lightness(i, look.aces2_fitted(colour, hue, {line.r, line.g, line.b}));
  }
}
CANDELA_ACES2_STEP aces2_show(Aces2 look, uint32_t count, const Aces2Chunk& colours, Chunk& shown) {
  for (uint32_t i = 0; i < count; i += kLanes) {
    shown.set_rgb(i, at_most(at_least(look.aces2_shown(colours.colour(i)), 0.0), 1.0));
  }
}

HWY_NOINLINE inline void show_aces2(const RowPart& part, Chunk& chunk) {
  const Aces2 look(part.job);
  Aces2Chunk colours;
  const uint32_t count = part.count;
  aces2_see(look, part.job.constants.wide != 0, count, chunk);
  aces2_turn(look, count, chunk, colours);
  aces2_look_up(look, count, colours);
  aces2_tone(look, count, colours);
  aces2_draw_lines(look, count, colours);
  aces2_fit(look, count, colours);
  aces2_show(look, count, colours, chunk);
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
