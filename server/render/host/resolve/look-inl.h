// Stages of resolve from exposed light to display values. They are the shaders' own text, except for the full
// form of sRGB and the shape of AgX.
#if defined(CANDELA_HOST_LOOK_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_LOOK_INL_H
#undef CANDELA_HOST_LOOK_INL_H
#else
#define CANDELA_HOST_LOOK_INL_H
#endif

#include <hwy/highway.h>

#include "server/render/host/resolve/aces2-inl.h"
#include "server/render/host/resolve/agx-inl.h"
#include "server/render/host/resolve/chunk-inl.h"
#include "server/render/host/resolve/srgb-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// The shared files stand between two files of macros.
// clang-format off
namespace shared {
using namespace glsl;    // NOLINT: GLSL has no namespaces
using namespace shader;  // NOLINT

template <uint32_t CURVE, uint32_t TRANSFER, uint32_t TRANSFER_TERMS, uint32_t DISPLAY = DISPLAY_REC709>
struct Look {
  const ResolveParams& p;
  const utextureBuffer table_points;
#include "server/render/host/lanes/glsl-begin.h"
#include "shaders/glsl/transfer.glsl"
#include "shaders/glsl/table.glsl"
#include "shaders/glsl/curves.glsl"
#include "server/render/host/lanes/glsl-end.h"
};

struct Straight {
#include "server/render/host/lanes/glsl-begin.h"
#include "shaders/glsl/straight.glsl"
#include "server/render/host/lanes/glsl-end.h"
};

struct Gain {
  const utextureBuffer gain_points;
#include "server/render/host/lanes/glsl-begin.h"
#include "shaders/glsl/gain.glsl"
#include "server/render/host/lanes/glsl-end.h"
};

struct Dither {
#include "server/render/host/lanes/glsl-begin.h"
#include "shaders/glsl/dither.glsl"
#include "server/render/host/lanes/glsl-end.h"
};
}  // namespace shared
// clang-format on

// Everything that a stage calls is inlined into its loop.
#define CANDELA_STAGE HWY_NOINLINE HWY_FLATTEN

template <uint32_t kCurve, uint32_t kDisplay = shader::DISPLAY_REC709>
CANDELA_STAGE void show_curve(const RowPart& part, Chunk& chunk) {
  const ResolveJob& job = part.job;
  shared::Look<kCurve, shader::TRANSFER_LINEAR, 8, kDisplay> look{job.params, {job.table, job.table_points}};
  const bool wide = job.constants.wide != 0;  // only then is light negative
  const uint32_t count = part.count;
  for (uint32_t i = 0; i < count; i += kLanes) {
    const vec3 light = look.curve_light(chunk.rgb(i));
    chunk.set_rgb(i, look.curve(wide ? at_least(light, 0.0) : light, job.params.curve_white));
  }
}

// A look-up is two stages, because the second one waits for memory, in which it also finds the points'
// places.
struct TableCells {
  HWY_ALIGN uint32_t corners[3][kChunk], fractions[3][kChunk];
};

template <uint32_t kCurve>
using TableLook = shared::Look<kCurve, shader::TRANSFER_LINEAR, 8>;

template <uint32_t kCurve>
CANDELA_STAGE void find_cells(TableLook<kCurve> look, bool wide, uint32_t count, const Chunk& chunk,
                              TableCells& cells) {
  const U last = look.table_points.elements - 1;
  for (uint32_t i = 0; i < count; i += kLanes) {
    vec3 light = look.curve_light(chunk.rgb(i));
    if (wide) light = at_least(light, 0.0);
    if constexpr (kCurve == shader::CURVE_TABLE_AP1) light = look.within_axes(light);
    const auto cell = look.table_cell(light);
    hn::Store(min(cell.corners.r, last).v, kUints, cells.corners[0] + i);
    hn::Store(min(cell.corners.g, last).v, kUints, cells.corners[1] + i);
    hn::Store(min(cell.corners.b, last).v, kUints, cells.corners[2] + i);
    hn::Store(cell.fractions.r.v, kUints, cells.fractions[0] + i);
    hn::Store(cell.fractions.g.v, kUints, cells.fractions[1] + i);
    hn::Store(cell.fractions.b.v, kUints, cells.fractions[2] + i);
  }
}
template <uint32_t kCurve>
CANDELA_STAGE void interpolate(TableLook<kCurve> look, uint32_t count, const TableCells& cells,
                               Chunk& chunk) {
  const uint32_t* const words = look.table_points.words;
  for (uint32_t i = 0; i < count; i += kLanes) {
    const auto points = [&](const uint32_t* at)
                            HWY_ATTR { return glsl::transposed_elements(words, at + i).rgb; };
    const auto fraction = [&](const uint32_t* of) HWY_ATTR { return U(hn::Load(kUints, of + i)); };
    vec3 shown = look.interpolated(
        points(cells.corners[0]), points(cells.corners[1]), points(cells.corners[2]),
        {fraction(cells.fractions[0]), fraction(cells.fractions[1]), fraction(cells.fractions[2])});
    if constexpr (kCurve != shader::CURVE_TABLE_REC709) shown = look.from_table(shown);
    chunk.set_rgb(i, at_most(at_least(shown, 0.0), 1.0));
  }
}
template <uint32_t kCurve>
HWY_NOINLINE void show_table(const RowPart& part, Chunk& chunk) {
  const ResolveJob& job = part.job;
  const TableLook<kCurve> look{job.params, {job.table, job.table_points}};
  TableCells cells;
  find_cells<kCurve>(look, job.constants.wide != 0, part.count, chunk, cells);
  interpolate<kCurve>(look, part.count, cells, chunk);
}

template <typename Step>
HWY_INLINE void each_component(const RowPart& part, Chunk& chunk, const Step& step) {
  const uint32_t count = part.count;
  for (uint32_t i = 0; i < count; i += kLanes) {
    const vec3 x = chunk.rgb(i);
    chunk.set_rgb(i, {step(x.r), step(x.g), step(x.b)});
  }
}

// AgX is two stages: in one loop, each pixel would wait for a chain of operations that is longer than what
// the processor looks ahead.
CANDELA_STAGE inline void agx_stops_stage(const RowPart& part, Chunk& chunk) {
  shared::Look<shader::CURVE_AGX, shader::TRANSFER_LINEAR, 8> look{part.job.params, {}};
  const uint32_t count = part.count;
  for (uint32_t i = 0; i < count; i += kLanes) {
    const vec3 inset = look.curve_light(chunk.rgb(i));  // agx_stops() cuts what is negative
    chunk.set_rgb(i, {look.agx_stops(inset.r), look.agx_stops(inset.g), look.agx_stops(inset.b)});
  }
}
CANDELA_STAGE inline void agx_shape_stage(const RowPart& part, Chunk& chunk) {
  each_component(part, chunk, [](F x) HWY_ATTR { return agx_shaped(x); });
}
inline void show_agx(const RowPart& part, Chunk& chunk) {
  agx_stops_stage(part, chunk);
  agx_shape_stage(part, chunk);
}

template <uint32_t kTransfer, uint32_t kTerms = 8, uint32_t kDisplay = shader::DISPLAY_REC709>
CANDELA_STAGE void show_transfer(const RowPart& part, Chunk& chunk) {
  shared::Look<shader::CURVE_LINEAR, kTransfer, kTerms, kDisplay> look{part.job.params, {}};
  for (uint32_t i = 0; i < part.count; i += kLanes) chunk.set_rgb(i, look.encode(chunk.rgb(i)));
}

CANDELA_STAGE inline void show_srgb(const RowPart& part, Chunk& chunk) {
  each_component(part, chunk, [](F y) HWY_ATTR { return srgb(y); });
}

CANDELA_STAGE inline void p3_in_rec2020(const RowPart& part, Chunk& chunk) {
  shared::Look<shader::CURVE_LINEAR, shader::TRANSFER_LINEAR, 8> look{part.job.params, {}};
  for (uint32_t i = 0; i < part.count; i += kLanes) chunk.set_rgb(i, look.p3_in_rec2020(chunk.rgb(i)));
}
inline void show_aces2_of_p3_in_rec2020(const RowPart& part, Chunk& chunk) {
  show_aces2(part, chunk);
  p3_in_rec2020(part, chunk);
}

template <uint32_t kCurve>
Stage stage_for_display(uint32_t display) {
  if (display == shader::DISPLAY_REC2020) return show_curve<kCurve, shader::DISPLAY_REC2020>;
  if (display == shader::DISPLAY_P3_D65) return show_curve<kCurve, shader::DISPLAY_P3_D65>;
  return show_curve<kCurve>;
}

inline Stage curve_stage(const shader::ResolveConstants& constants) {
  const uint32_t display = constants.display;
  switch (constants.curve) {
    case shader::CURVE_REINHARD:
      return show_curve<shader::CURVE_REINHARD>;
    case shader::CURVE_ACES_NARKOWICZ:
      return show_curve<shader::CURVE_ACES_NARKOWICZ>;
    case shader::CURVE_ACES_HILL:
      return show_curve<shader::CURVE_ACES_HILL>;
    case shader::CURVE_REINHARD_EXTENDED:
      return show_curve<shader::CURVE_REINHARD_EXTENDED>;
    case shader::CURVE_HABLE:
      return show_curve<shader::CURVE_HABLE>;
    case shader::CURVE_AGX:
      return show_agx;
    case shader::CURVE_PBR_NEUTRAL:
      return show_curve<shader::CURVE_PBR_NEUTRAL>;
    case shader::CURVE_ACES_1:
    case shader::CURVE_TABLE:
      return show_table<shader::CURVE_TABLE>;
    case shader::CURVE_TABLE_REC709:
      return show_table<shader::CURVE_TABLE_REC709>;
    case shader::CURVE_TABLE_AP1:
      return show_table<shader::CURVE_TABLE_AP1>;
    case shader::CURVE_ACES_2:
      return constants.limit == display ? show_aces2 : show_aces2_of_p3_in_rec2020;
    case shader::CURVE_BT2390:
      return stage_for_display<shader::CURVE_BT2390>(display);
    default:
      return stage_for_display<shader::CURVE_LINEAR>(display);
  }
}

inline void no_stage(const RowPart&, Chunk&) {}

inline Stage transfer_stage(const shader::ResolveConstants& constants) {
  const uint32_t transfer = constants.transfer;
  if (transfer == shader::TRANSFER_GAMMA22) return show_transfer<shader::TRANSFER_GAMMA22>;
  if (transfer == shader::TRANSFER_PQ) return show_transfer<shader::TRANSFER_PQ>;
  if (transfer == shader::TRANSFER_HLG) {
    return constants.display == shader::DISPLAY_P3_D65
               ? show_transfer<shader::TRANSFER_HLG, 8, shader::DISPLAY_P3_D65>
               : show_transfer<shader::TRANSFER_HLG, 8, shader::DISPLAY_REC2020>;
  }
  if (transfer != shader::TRANSFER_SRGB) return no_stage;
  // Six terms differ from the exact curve by more than a code of 16 bits, so both executors take the same
  // ones.
  return constants.transfer_terms == 6 ? show_transfer<shader::TRANSFER_SRGB, 6> : show_srgb;
}

// Alpha becomes the code of the gain map, of exposed light.
CANDELA_STAGE inline void show_gain(const RowPart& part, Chunk& chunk) {
  shared::Gain gain{{part.job.gain, shader::GAIN_PIECES}};
  const uint32_t count = part.count;
  for (uint32_t i = 0; i < count; i += kLanes) chunk.set_alpha(i, gain.gain_code(chunk.rgb(i)));
}

// Splits exposed light: `chunk` keeps the object's, divided by alpha, and `own` takes the rest.
CANDELA_STAGE inline void split_straight(const RowPart& part, Chunk& chunk, Chunk& own) {
  shared::Straight straight;
  const uint32_t count = part.count;
  for (uint32_t i = 0; i < count; i += kLanes) {
    const auto light = straight.straight_light(chunk.rgb(i), chunk.alpha(i));
    chunk.set_rgb(i, light.object);
    own.set_rgb(i, light.own);
  }
}

// Joins both, as they are shown, to pixels with straight alpha. `black` is how no light is shown.
CANDELA_STAGE inline void join_straight(const RowPart& part, Chunk& chunk, const Chunk& own,
                                        const Chunk& own_shown, const Chunk& black) {
  shared::Straight straight;
  const uint32_t count = part.count;
  for (uint32_t i = 0; i < count; i += kLanes) {
    const auto pixel = straight.straight_pixel({vec3(0.0), own.rgb(i)}, chunk.rgb(i), own_shown.rgb(i),
                                               black.rgb(0), chunk.alpha(i));
    chunk.set_rgb(i, pixel.colour);
    chunk.set_alpha(i, pixel.alpha);
  }
}

// Adds the noise to values in codes, which stay from 0 to `codes`.
HWY_INLINE vec3 dithered(const RowPart& part, uint32_t i, const vec3& values, F codes) {
  shared::Dither dither;
  const U x = U(hn::LoadU(kUints, kPixelOfLane.data())) + U(part.x + i);
  const vec3 noise = dither.dither_noise(x, part.y, part.job.params.dither_frame);
  return {min(max(values.r + noise.r, 0.0), codes), min(max(values.g + noise.g, 0.0), codes),
          min(max(values.b + noise.b, 0.0), codes)};
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
