// The last pass on the host: from the frame's light to finished pixels, for each target of Highway, and on a
// crew of threads.
#include "server/render/host/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/resolve.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>

#include "absl/synchronization/mutex.h"
#include "server/base/check.h"
#include "server/render/host/bloom.h"
#include "server/render/host/resolve.h"

#if CANDELA_HOST_TARGET
#include "server/render/host/light-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// The powers of ACES 2.0 (docs/pipeline.md section 5) without logarithms, for each target of Highway: x = 2^e
// m with 1 <= m < 2, so a power of x is the product of that of 2^e, from two tables in registers, and a
// polynomial for that of m. The errors are of the polynomials, whose values are 1 to 5.2.

using glsl::F;
using glsl::U;

// Powers of 2^k and of 2^(16 k - 127), 0 <= k < 16.
struct PowersOfTwo {
  alignas(64) std::array<float, 16> low{};
  alignas(64) std::array<float, 16> high{};

  constexpr explicit PowersOfTwo(double power_of_2) {
    double power = 1;
    for (float& one : low) {
      one = static_cast<float>(power);
      power *= power_of_2;
    }
    const double step = power;
    power = 1;
    for (int i = 0; i < 127; ++i) power /= power_of_2;
    for (float& one : high) {
      one = static_cast<float>(std::min<double>(power, std::numeric_limits<float>::max()));
      power *= step;
    }
  }
};

HWY_INLINE F power_of_two(const PowersOfTwo& powers, F x) {
  const U exponent = glsl::floatBitsToUint(x) >> 23;
  return F(look_up(powers.low, exponent.v)) * F(look_up(powers.high, (exponent >> 4).v));
}
HWY_INLINE F mantissa(F x) {
  return glsl::uintBitsToFloat((glsl::floatBitsToUint(x) & U(0x007fffffu)) | U(0x3f800000u));
}

// m^0.42.
// fit: m in [1, 2], degree 6, error 2.1e-07, best 1.9e-07
HWY_INLINE F cone_mantissa(F m) {
  F q = m * -0.00279401592 + 0.0303788036;
  q = q * m - 0.1431503;
  q = q * m + 0.386431813;
  q = q * m - 0.683716714;
  q = q * m + 1.06558919;
  q = q * m + 0.347261429;
  return q;
}
// m^(1/0.42).
// fit: m in [1, 2], degree 5, error 5.6e-07, best 5.5e-07
HWY_INLINE F cone_root_mantissa(F m) {
  F q = m * 0.00381008652 - 0.0457441919;
  q = q * m + 0.351129234;
  q = q * m + 0.827502012;
  q = q * m - 0.163555652;
  q = q * m + 0.0268590692;
  return q;
}
// m^1.13705602.
// fit: m in [1, 2], degree 5, error 3.0e-07, best 3.0e-07
HWY_INLINE F lightness_mantissa(F m) {
  F q = m * -0.00138433697 + 0.0138674658;
  q = q * m - 0.0625672042;
  q = q * m + 0.195957631;
  q = q * m + 0.884317696;
  q = q * m - 0.03019155;
  return q;
}
// m^(1/1.13705602).
// fit: m in [1, 2], degree 5, error 3.2e-07, best 3.2e-07
HWY_INLINE F achromatic_mantissa(F m) {
  F q = m * 0.0013843741 - 0.0135723921;
  q = q * m + 0.0586417578;
  q = q * m - 0.161011502;
  q = q * m + 1.07290435;
  q = q * m + 0.0416537337;
  return q;
}

// The functions of shaders/glsl/aces2_powers.glsl, for x >= 0.
struct Aces2Powers {
  static HWY_INLINE F cone_power(F x) {
    static constexpr PowersOfTwo kPowers(1.337927554786112);
    return power_of_two(kPowers, x) * cone_mantissa(mantissa(x));
  }
  static HWY_INLINE F cone_root(F x) {
    static constexpr PowersOfTwo kPowers(5.208804828372927);
    return power_of_two(kPowers, x) * cone_root_mantissa(mantissa(x));
  }
  static HWY_INLINE F lightness_of(F x) {
    static constexpr PowersOfTwo kPowers(2.1993176987586445);
    return power_of_two(kPowers, x) * lightness_mantissa(mantissa(x));
  }
  static HWY_INLINE F achromatic_of(F x) {
    static constexpr PowersOfTwo kPowers(1.8396918624132315);
    return power_of_two(kPowers, x) * achromatic_mantissa(mantissa(x));
  }
};

// ACES 2.0 on the host: the shaders' own text, except for its powers. For each target of Highway.
//
// Each step is a loop of its own over the chunk. In one loop, each pixel would wait for a chain of operations
// that is longer than what the processor looks ahead.

// clang-format off
namespace shared {
using namespace glsl;    // NOLINT: GLSL has no namespaces
using namespace shader;  // NOLINT

struct Aces2 : Aces2Powers {
  const utextureBuffer table_points;
  explicit Aces2(const ResolveJob& job) : table_points{job.table, job.table_points} { load_aces2(); }
#include "server/render/host/glsl-begin.h"
#include "shaders/glsl/log2.glsl"
#include "shaders/glsl/aces2.glsl"
#include "server/render/host/glsl-end.h"
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

// AgX's base curve with the power that makes it light (docs/pipeline.md section 5), for each target of
// Highway.
//
// curves.glsl takes two logarithms, two exponentials and two square roots of each component for it. Both
// together are a function of one number from 0 to 1. Here sixteen polynomials make it, whose coefficients a
// vector register holds.

// The coefficient of v^k of piece j is kAgxPieces[k][j].
alignas(64) inline constexpr std::array<float, 16> kAgxPieces[6] = {
    {{-9.441061e-06f, 2.0318207e-06f, 3.0163432e-05f, 1.5961051e-04f, 6.4403465e-04f, 0.00236641f,
      0.008286133f, 0.026694747f, 0.07273542f, 0.15889727f, 0.2866043f, 0.45288995f, 0.6369307f, 0.7980297f,
      0.91106844f, 0.98058844f}},
    {{1.02327176e-04f, 8.551533e-06f, 5.842577e-05f, 2.3670345e-04f, 8.5846963e-04f, 0.0030217285f,
      0.010136632f, 0.029386088f, 0.06501644f, 0.10723384f, 0.14815158f, 0.18106575f, 0.17939688f,
      0.13837136f, 0.08892889f, 0.052816436f}},
    {{-4.387103e-04f, 1.16580695e-05f, 4.4587363e-05f, 1.5606276e-04f, 5.447783e-04f, 0.0018800057f,
      0.0058764187f, 0.013900682f, 0.02071658f, 0.02067997f, 0.020190015f, 0.010042274f, -0.012332593f,
      -0.025505306f, -0.022101328f, -0.014085572f}},
    {{9.3263586e-04f, 5.7845023e-06f, 1.8863242e-05f, 6.4887456e-05f, 2.2728386e-04f, 7.592826e-04f,
      0.0020304874f, 0.0030118774f, 0.001064773f, -4.9679296e-04f, -9.0862636e-04f, -0.0061126393f,
      -0.007254303f, -0.0011326314f, 0.0025461195f, 0.002458659f}},
    {{-9.882797e-04f, 1.5501578e-06f, 5.862189e-06f, 2.068641e-05f, 7.208365e-05f, 2.1695279e-04f,
      3.8275245e-04f, -7.571099e-05f, -6.97021e-04f, 1.2877847e-04f, -9.437572e-04f, -0.0012353949f,
      9.084133e-04f, 0.0015179014f, 3.214421e-04f, -2.064441e-04f}},
    {{4.2141398e-04f, 5.8218257e-07f, 1.4664763e-06f, 5.2338946e-06f, 1.7435394e-05f, 4.0703446e-05f,
      9.900097e-08f, -1.801769e-04f, 2.0465883e-05f, 2.4018413e-04f, -2.2531445e-04f, 2.1112784e-04f,
      4.44038e-04f, -1.8242215e-04f, -1.9703714e-04f, -3.63401e-05f}}};

// The light, 0 to 1, of agx_stops() x. The curve's second half begins at 10/16.5, where a piece begins, too.
// fit: 16 pieces, degree 5, error 6.7e-08, best 5.6e-08
HWY_INLINE F agx_shaped(F x) {
  const F at = x * 15.0 + (10.0 - 15.0 * 10.0 / 16.5);
  const glsl::I piece(at);
  const U index(piece);
  const F v = (at - F(piece)) - 0.5;
  F y = look_up(kAgxPieces[5], index.v);
  for (size_t k = 5; k-- > 0;) y = y * v + F(look_up(kAgxPieces[k], index.v));
  return min(max(y, 0.0), 1.0);
}

// The sRGB transfer (docs/pipeline.md section 5) without square roots, for each target of Highway.
//
// transfer.glsl takes two square roots of each component, and a core needs many cycles for a vector of them.
// Here x = 2^e m with 1 <= m < 2, so x^(1/2.4) is the product of 2^(e/2.4), from a table in registers, and a
// polynomial for m^(1/2.4).

// 1.055 * 2^(e / 2.4) at the lowest four bits of the exponent field of 2^e, for -9 <= e <= 0.
alignas(64) inline constexpr auto kScaledPowers = [] {
  constexpr double kOneDown = 0.749153538438341;  // 2^(-1 / 2.4)
  std::array<float, 16> powers{};
  double power = 1.055;
  for (size_t i = 15; i >= 6; --i, power *= kOneDown) powers[i] = static_cast<float>(power);
  return powers;
}();

// m^(1/2.4). Errors are in 8-bit codes of the octave below 1.
// fit: m in [1, 2], degree 6, error 3.9e-05, best 3.8e-05
HWY_INLINE F mantissa_power(F m) {
  F q = m * -0.00279865926 + 0.0304253306;
  q = q * m - 0.143340468;
  q = q * m + 0.386805862;
  q = q * m - 0.683820426;
  q = q * m + 1.06189704;
  q = q * m + 0.350831509;
  return q;
}

// The display value of display light from 0 to 1.
HWY_INLINE F srgb(F x) {
  const U bits = glsl::floatBitsToUint(x);
  const F m = glsl::uintBitsToFloat((bits & U(0x007fffffu)) | U(0x3f800000u));
  const F high = look_up(kScaledPowers, (bits >> 23).v) * mantissa_power(m) - 0.055;
  return mix(high, F(12.92 * x), x <= F(0.0031308));
}

// Stages of resolve from exposed light to display values. They are the shaders' own text, except for the full
// form of sRGB and the shape of AgX.

// The shared files stand between two files of macros.
// clang-format off
namespace shared {
using namespace glsl;    // NOLINT: GLSL has no namespaces
using namespace shader;  // NOLINT

template <uint32_t CURVE, uint32_t TRANSFER, uint32_t TRANSFER_TERMS, uint32_t DISPLAY = DISPLAY_REC709>
struct Look {
  const ResolveParams& p;
  const utextureBuffer table_points;
#include "server/render/host/glsl-begin.h"
#include "shaders/glsl/transfer.glsl"
#include "shaders/glsl/table.glsl"
#include "shaders/glsl/curves.glsl"
#include "server/render/host/glsl-end.h"
};

struct Straight {
#include "server/render/host/glsl-begin.h"
#include "shaders/glsl/straight.glsl"
#include "server/render/host/glsl-end.h"
};

struct Gain {
  const utextureBuffer gain_points;
#include "server/render/host/glsl-begin.h"
#include "shaders/glsl/gain.glsl"
#include "server/render/host/glsl-end.h"
};

struct Dither {
#include "server/render/host/glsl-begin.h"
#include "shaders/glsl/dither.glsl"
#include "server/render/host/glsl-end.h"
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
    case shader::CURVE_SHOULDER:
      return show_curve<shader::CURVE_SHOULDER>;
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

// Counts what the curve cuts of a `wide` frame, and how bright an image in PQ or HLG is; see
// shaders/resolve.comp.

// Notes how far the scene's light is below 0, before bloom.
HWY_NOINLINE inline void note_negative(const RowPart& part, const Chunk& chunk, ResolveFound& found) {
  VF least = hn::Zero(kFloats);
  for (uint32_t i = 0; i < part.count; i += kLanes) {
    const vec3 c = chunk.rgb(i);
    least = hn::Min(least, min(min(c.r, c.g), c.b).v);
  }
  const float below = (0.0f - hn::GetLane(hn::MinOfLanes(kFloats, least))) * part.job.params.exposure;
  found.negative_light_bits = std::max(found.negative_light_bits, std::bit_cast<uint32_t>(below));
}

// A row of a matrix times a colour, each step rounded: the count is the same on every processor.
HWY_INLINE F precise_row(const float* m, const vec3& c) {
  return hn::Add(hn::Add(hn::Mul(set(m[0]), c.r.v), hn::Mul(set(m[1]), c.g.v)), hn::Mul(set(m[2]), c.b.v));
}

// The first matrix of the curve, from Rec.709 to where it cuts.
inline const float* curve_matrix(uint32_t curve, uint32_t display) {
  static constexpr float kRec709[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  static constexpr float kAces[9] = {TABLE_FROM_SCENE};
  static constexpr float kAp1[9] = {TABLE_FROM_SCENE_AP1};
  static constexpr float kAgx[9] = {AGX_INSET};
  static constexpr float kRec2020[9] = {REC709_TO_REC2020};
  static constexpr float kP3[9] = {REC709_TO_P3_D65};
  switch (curve) {
    case shader::CURVE_ACES_HILL:
    case shader::CURVE_ACES_1:
    case shader::CURVE_TABLE:
      return kAces;
    case shader::CURVE_TABLE_AP1:
    case shader::CURVE_ACES_2:
      return kAp1;
    case shader::CURVE_AGX:
      return kAgx;
    default:
      return display == shader::DISPLAY_REC2020  ? kRec2020
             : display == shader::DISPLAY_P3_D65 ? kP3
                                                 : kRec709;
  }
}

// Of exposed light. A table with the axes AP1 knows nothing of what is outside of AP1, so its error there is
// not that of a rounding.
HWY_NOINLINE inline void count_cut(const RowPart& part, const Chunk& chunk, ResolveFound& found) {
  const float* const matrix = curve_matrix(part.job.constants.curve, part.job.constants.display);
  const F roundings = -0x1p-20f;
  const F tolerance = -shader::GAMUT_TOLERANCE;
  VI outside = hn::Zero(kInts);
  VI cut = hn::Zero(kInts);
  const VI pixels = hn::LoadU(kInts, reinterpret_cast<const int32_t*>(kPixelOfLane.data()));
  for (uint32_t i = 0; i < part.count; i += kLanes) {
    const vec3 x = chunk.rgb(i);
    const F largest = max(max(abs(x.r), abs(x.g)), abs(x.b));
    const vec3 v = {precise_row(matrix, x), precise_row(matrix + 3, x), precise_row(matrix + 6, x)};
    const MF counted =
        hn::RebindMask(kFloats, hn::Lt(pixels, hn::Set(kInts, static_cast<int32_t>(part.count - i))));
    const auto add = [&](glsl::B which, VI* count) HWY_ATTR {
      *count = hn::Sub(*count, hn::BitCast(kInts, hn::VecFromMask(kFloats, hn::And(which.m, counted))));
    };
    const F limit = tolerance * largest;
    add(v.r < limit, &cut);
    add(v.g < limit, &cut);
    add(v.b < limit, &cut);
    add(min(min(v.r, v.g), v.b) < F(roundings * largest), &outside);
  }
  found.gamut_cut_components += static_cast<uint32_t>(hn::GetLane(hn::SumOfLanes(kInts, cut)));
  const bool some = hn::GetLane(hn::SumOfLanes(kInts, outside)) != 0;
  if (some && part.job.constants.curve == shader::CURVE_TABLE_AP1) found.negative_light_bits = 0x7f800000u;
}

// Of display light.
HWY_NOINLINE inline void note_shown(const RowPart& part, const Chunk& chunk, ResolveFound& found) {
  VF most = hn::Zero(kFloats);
  VI sum = hn::Zero(kInts);
  const VI pixels = hn::LoadU(kInts, reinterpret_cast<const int32_t*>(kPixelOfLane.data()));
  for (uint32_t i = 0; i < part.count; i += kLanes) {
    const vec3 light = chunk.rgb(i);
    const F largest = max(max(light.r, light.g), light.b);
    const auto counted =
        hn::RebindMask(kFloats, hn::Lt(pixels, hn::Set(kInts, static_cast<int32_t>(part.count - i))));
    most = hn::Max(most, hn::IfThenElseZero(counted, largest.v));
    const F scaled = largest * shader::SHOWN_SCALE + F(0.5);
    sum = hn::Add(sum, hn::ConvertTo(kInts, hn::IfThenElseZero(counted, scaled.v)));
  }
  found.shown_max_bits =
      std::max(found.shown_max_bits, std::bit_cast<uint32_t>(hn::GetLane(hn::MaxOfLanes(kFloats, most))));
  found.shown_sum += static_cast<uint32_t>(hn::GetLane(hn::SumOfLanes(kInts, sum)));
}

// The last stages of resolve: finished pixels in the output's format.

// Bytes of a texel of the output.
constexpr size_t output_bytes(uint32_t format) {
  return format == shader::OUTPUT_RGBA8 ? 4 : format == shader::OUTPUT_FLOAT ? 16 : 8;
}

// Values in [0, 1], times the largest code and rounded to integers: the low bits of the result. What is above
// them is that of 2^23.
template <bool kDither>
HWY_INLINE glsl::uvec3 codes_of(const RowPart& part, uint32_t i, const vec3& rgb, F largest) {
  const F whole = 8388608.0f;
  if constexpr (kDither) {
    const vec3 v = dithered(part, i, {F(rgb.r * largest), F(rgb.g * largest), F(rgb.b * largest)}, largest);
    return {floatBitsToUint(v.r + whole), floatBitsToUint(v.g + whole), floatBitsToUint(v.b + whole)};
  } else {
    return {floatBitsToUint(rgb.r * largest + whole), floatBitsToUint(rgb.g * largest + whole),
            floatBitsToUint(rgb.b * largest + whole)};
  }
}

HWY_INLINE U alpha_code(F alpha, F largest) {
  return floatBitsToUint(min(max(alpha, 0.0), 1.0) * largest + F(8388608.0f));
}

// Stores kLanes texels of the format.
template <uint32_t kFormat, bool kDither, bool kStream>
HWY_INLINE void store_texels(const RowPart& part, const Chunk& chunk, bool opaque, uint32_t i,
                             std::byte* to) {
  const vec3 rgb = chunk.rgb(i);
  const F a = opaque ? F(1.0) : chunk.alpha(i);
  auto* const words = reinterpret_cast<uint32_t*>(to);
  if constexpr (kFormat == shader::OUTPUT_RGBA8) {
    const auto codes = codes_of<kDither>(part, i, rgb, 255.0f);
    // Shifting moves the bits of 2^23 out of the word. Only those of R stay and are subtracted.
    const U rg = codes.r + (codes.g << 8);
    const U ba = (codes.b << 16) + (alpha_code(a, 255.0f) << 24);
    const VU texels = natural((rg + ba - U(0x4b000000u)).v);
    if constexpr (kStream) {
      hn::Stream(texels, kUints, words);
    } else {
      hn::StoreU(texels, kUints, words);
    }
  } else if constexpr (kFormat == shader::OUTPUT_RGBA16) {
    const auto codes = codes_of<kDither>(part, i, rgb, 65535.0f);
    const U low = 0xffffu;
    const U rg = (codes.r & low) | (codes.g << 16);
    const U ba = (codes.b & low) | (alpha_code(a, 65535.0f) << 16);
    hn::StoreInterleaved2(natural(rg.v), natural(ba.v), kUints, words);
  } else if constexpr (kFormat == shader::OUTPUT_RGBA16F) {
    const hn::Rebind<hwy::float16_t, DF> halves;
    const hn::Rebind<uint16_t, DF> bits;
    const auto half = [&](F x) HWY_ATTR { return hn::BitCast(bits, hn::DemoteTo(halves, natural(x.v))); };
    hn::StoreInterleaved4(half(rgb.r), half(rgb.g), half(rgb.b), half(a), bits,
                          reinterpret_cast<uint16_t*>(to));
  } else {
    hn::StoreInterleaved4(natural(rgb.r.v), natural(rgb.g.v), natural(rgb.b.v), natural(a.v), kFloats,
                          reinterpret_cast<float*>(to));
  }
}

template <uint32_t kFormat, bool kDither, bool kStream>
HWY_NOINLINE void write_texels(const RowPart& part, const Chunk& chunk, std::byte* to) {
  constexpr size_t kBytes = output_bytes(kFormat);
  const uint32_t count = part.count;
  const bool opaque = part.job.opaque;
  uint32_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    store_texels<kFormat, kDither, kStream>(part, chunk, opaque, i, to + i * kBytes);
  }
  if (i == count) return;
  alignas(32) std::byte last[kLanes * kBytes];
  store_texels<kFormat, kDither, false>(part, chunk, opaque, i, last);
  std::memcpy(to + i * kBytes, last, (count - i) * kBytes);
}

template <uint32_t kFormat, bool kDither>
HWY_NOINLINE void write_pixels(const RowPart& part, Chunk& chunk) {
  const size_t first = size_t{part.y} * part.job.params.output_pitch + part.x;
  std::byte* const to = part.job.output + first * output_bytes(kFormat);
  // Past the caches where it can be: nothing here reads it again.
  const bool aligned = reinterpret_cast<uintptr_t>(to) % (kLanes * sizeof(uint32_t)) == 0;
  if (kFormat == shader::OUTPUT_RGBA8 && aligned) {
    write_texels<kFormat, kDither, true>(part, chunk, to);
  } else {
    write_texels<kFormat, kDither, false>(part, chunk, to);
  }
}

inline Stage write_stage(uint32_t format, bool dither) {
  switch (format) {
    case shader::OUTPUT_RGBA16:
      return dither ? write_pixels<shader::OUTPUT_RGBA16, true> : write_pixels<shader::OUTPUT_RGBA16, false>;
    case shader::OUTPUT_RGBA16F:
      return write_pixels<shader::OUTPUT_RGBA16F, false>;
    case shader::OUTPUT_FLOAT:
      return write_pixels<shader::OUTPUT_FLOAT, false>;
    default:
      return dither ? write_pixels<shader::OUTPUT_RGBA8, true> : write_pixels<shader::OUTPUT_RGBA8, false>;
  }
}

// The stages of a job, chosen once.
class Resolve {
 public:
  explicit Resolve(const ResolveJob& job)
      : job_(job),
        load_(is_usual(job) ? load_exposed_stage(job.constants) : load_stage(job.constants)),
        expose_(is_usual(job) ? no_stage : expose_stage(job.constants)),
        curve_(curve_stage(job.constants)),
        transfer_(transfer_stage(job.constants)),
        write_(write_stage(job.constants.output_format, job.constants.dither != 0)),
        counts_(job.constants.wide != 0 && job.constants.output_format != shader::OUTPUT_FLOAT),
        measures_(counts_ && job.constants.display != shader::DISPLAY_REC709) {
    if (job.constants.alpha != shader::ALPHA_STRAIGHT) return;
    std::memset(black_.c, 0, sizeof black_.c);
    show({job, 0, 0, kLanes, {}}, black_, nullptr);
  }

  void make(const RowPart& part, ResolveFound& found) const {
    Chunk chunk;
    load_(part, chunk);
    if (counts_) note_negative(part, chunk, found);
    expose_(part, chunk);
    if (counts_) count_cut(part, chunk, found);
    const uint32_t alpha = job_.constants.alpha;
    if (alpha != shader::ALPHA_ASSOCIATED) settle_alpha(part, chunk);
    if (job_.gain != nullptr) show_gain(part, chunk);
    if (alpha == shader::ALPHA_STRAIGHT) {
      show_straight(part, chunk, found);
    } else {
      show(part, chunk, &found);
    }
    write_(part, chunk);
  }

 private:
  // Notes in `found` how bright the light is, unless it is null.
  void show(const RowPart& part, Chunk& chunk, ResolveFound* found) const {
    curve_(part, chunk);
    if (measures_ && found != nullptr) note_shown(part, chunk, *found);
    transfer_(part, chunk);
  }

  void show_straight(const RowPart& part, Chunk& chunk, ResolveFound& found) const {
    Chunk own;
    split_straight(part, chunk, own);
    Chunk own_shown = own;
    show(part, chunk, &found);
    show(part, own_shown, nullptr);
    join_straight(part, chunk, own, own_shown, black_);
  }

  const ResolveJob& job_;
  const Stage load_;
  const Stage expose_;
  const Stage curve_;
  const Stage transfer_;
  const Stage write_;
  const bool counts_;
  const bool measures_;
  Chunk black_;  // its first register is how no light is shown; only for straight alpha
};

ResolveFound resolve_band(const ResolveJob& job, uint32_t first, uint32_t last) {
  ResolveFound found;
  const Resolve resolve(job);
  LightRow light(job);
  const uint32_t width = job.params.frame.width;
  for (uint32_t y = first; y < last; ++y) {
    const std::array<float*, 3>& row = light.make(y, 0, width);
    for (uint32_t x = 0; x < width; x += kChunk) {
      RowPart part = {job, x, y, std::min(kChunk, width - x), {}};
      for (uint32_t k = 0; k < 3 && row[k] != nullptr; ++k)
        part.light[k] = row[k] + x / job.constants.level_size;
      resolve.make(part, found);
    }
  }
  hwy::FlushStream();
  return found;
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#else

namespace candela::host::HWY_NAMESPACE {
ResolveFound resolve_band(const ResolveJob&, uint32_t, uint32_t) { return {}; }
}  // namespace candela::host::HWY_NAMESPACE

#endif

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(resolve_band);

ResolveFound resolve_rows(const ResolveJob& job, uint32_t first, uint32_t last) {
  return HWY_DYNAMIC_DISPATCH(resolve_band)(job, first, last);
}

namespace {

// A thread takes about this many bands of resolve in turn, so that all end at about the same time. A slice
// ends between two bands, so none has more texels than it makes in a few milliseconds.
constexpr uint32_t kBandsPerThread = 6;
constexpr uint32_t kMostTexelsOfBand = uint32_t{1} << 19;

struct Band {
  uint32_t first;
  uint32_t last;
};

// The rows of `groups`, which are rows of work groups, in bands for `threads` threads.
std::vector<Band> bands_of(const std::vector<Box>& groups, const shader::InputParams& frame,
                           uint32_t threads) {
  uint32_t rows = 0;
  for (const Box& box : groups) rows += box.y1 - box.y0;
  const uint32_t most = std::max<uint32_t>(1, kMostTexelsOfBand / (frame.width * kResolveGroupRows));
  const uint32_t step = std::clamp<uint32_t>(rows / (kBandsPerThread * threads), 1, most);
  std::vector<Band> bands;
  for (const Box& box : groups) {
    CHECK(box.y1 <= candela::groups(frame.height, kResolveGroupRows));
    for (uint32_t y = box.y0; y < box.y1; y += step) {
      bands.push_back(
          {y * kResolveGroupRows, std::min(std::min(y + step, box.y1) * kResolveGroupRows, frame.height)});
    }
  }
  return bands;
}

// Makes the rows of `groups`.
void run_groups(const ResolveJob& job, const std::vector<Box>& groups, Crew& crew, Drawn* drawn) {
  const std::vector<Band> bands = bands_of(groups, job.params.frame, crew.threads());
  absl::Mutex mutex;
  crew.run(static_cast<uint32_t>(bands.size()), [&](uint32_t i) {
    const ResolveFound found = resolve_rows(job, bands[i].first, bands[i].last);
    const absl::MutexLock lock(&mutex);
    drawn->gamut_cut_components += found.gamut_cut_components;
    drawn->negative_light = std::max(drawn->negative_light, std::bit_cast<float>(found.negative_light_bits));
    drawn->shown.largest = std::max<double>(drawn->shown.largest, std::bit_cast<float>(found.shown_max_bits));
    drawn->shown.mean += static_cast<double>(found.shown_sum) / shader::SHOWN_SCALE;  // a sum until the end
  });
}

Drawn run(const ResolveStep& step, const Tables& tables, const FrameTextures& textures, const Buffer& output,
          std::byte* tight_output, uint32_t format, Crew& crew) {
  ResolveJob job = {.constants = step.inputs.constants, .params = step.inputs.params, .opaque = step.opaque};
  job.constants.output_format = format;
  const bool resized = job.constants.pixels == shader::PIXELS_SCENE;
  job.wire = (resized ? textures.scene : textures.input).buffer().mapped();
  job.output = output.mapped();
  if (tight_output != nullptr) {
    job.output = tight_output;
    job.params.output_pitch = job.params.frame.width;
  }
  if (tables.colors != nullptr) {
    job.table = tables.colors->data()->data();
    job.table_points = static_cast<uint32_t>(tables.colors->size());
  }
  if (tables.gain != nullptr) {
    job.gain = tables.gain->data()->data();
    job.opaque = false;  // the map's codes are written where alpha would be
  }
  Drawn drawn;
  if (!step.bloom_groups.empty()) {
    job.level = level_planes(textures, 0);
    run_groups(job, step.bloom_groups, crew, &drawn);
  }
  // Bloom is exactly 0 there, so the shorter loop gives the same bits.
  job.constants.bloom = shader::BLOOM_NONE;
  run_groups(job, step.plain_groups, crew, &drawn);
  drawn.shown.mean /= double{1} * job.params.frame.width * job.params.frame.height;
  return drawn;
}

}  // namespace

Drawn run_resolve(const ResolveStep& step, const Tables& tables, const FrameTextures& textures,
                  std::byte* tight_output, Crew& crew) {
  return run(step, tables, textures, textures.output.buffer(), tight_output,
             static_cast<uint32_t>(textures.layout.output_format), crew);
}

void run_exact(const ResolveStep& step, const Tables& tables, const FrameTextures& textures, Crew& crew) {
  run(step, tables, textures, textures.exact.buffer(), nullptr, shader::OUTPUT_FLOAT, crew);
}

}  // namespace candela::host
#endif
