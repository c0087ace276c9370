// The tiles of ingest, for each target of Highway.
//
// A row of tiles is read in rows of texels from left to right, as they lie in memory. Each tile keeps its
// sums in between.
#include "server/render/host/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/ingest.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>

#include "server/render/host/ingest.h"
#include "server/render/host/lanes-inl.h"
#include "server/render/plan/exposure.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

#if CANDELA_HOST_TARGET

// What ingest adds up over a tile, for each target of Highway, and how it adds up a run without anything
// unusual.
//
// A run is a tile's part of a row. Most runs are plain: no component is negative and none needs the scrub.
// For those a few instructions suffice: the light for bloom is the luminance, and nothing is counted.

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

// How ingest adds up a tile's part of a row, whatever it holds and whatever is asked, for each target of
// Highway.

// A histogram of one copy's part of a row of tiles. A bin's sums share a word, the weight in the upper half:
// neither reaches 2^32.
class Bins {
 public:
  explicit Bins(uint32_t count) : count_(count) { std::fill_n(sums_.begin(), count, 0); }

  uint32_t count() const { return count_; }
  uint64_t operator[](size_t i) const { return sums_[i]; }
  uint64_t& operator[](size_t i) { return sums_[i]; }

 private:
  const uint32_t count_;
  std::array<uint64_t, shader::HISTOGRAM_SCRUB_BINS> sums_;
};

// Sums over a run, whatever it holds and whatever is asked.
template <uint32_t kPixels>
struct AnyRun {
  const IngestWork& work;
  const Input& input;
  Bins* bins;  // null: no histogram
  uint32_t y;
  TileSums& sums;
  // Weighted fixed_log2() in two parts: the lower 16 bits and the rest.
  VU log2_low = hn::Zero(kUints);
  VU log2_high = hn::Zero(kUints);

  AnyRun(const IngestWork& the_work, const Input& the_input, Bins* the_bins, uint32_t row, TileSums& the_sums)
      : work(the_work), input(the_input), bins(the_bins), y(row), sums(the_sums) {}

  // Reads `count` texels from column x on.
  void meter(const std::byte* at, uint32_t x, uint32_t count) {
    if (work.constants.scrub != 0 || input.scrub || input.matrix) {
      add_all<true, true>(at, x, count);
    } else if (work.constants.alpha == shader::METER_COVERAGE) {
      add_all<false, true>(at, x, count);
    } else {
      add_all<false, false>(at, x, count);
    }
    const VL high = add_wide(hn::Zero(kLongs), log2_high);
    sums.log2_sum = hn::Add(add_wide(sums.log2_sum, log2_low), hn::ShiftLeft<16>(high));
  }

  // Apart, because what a scrub, a matrix or coverage needs takes registers from the others. kConverts: there
  // may be a scrub or a matrix. kCovers: there may be coverage.
  template <bool kConverts, bool kCovers>
  HWY_INLINE void add_all(const std::byte* at, uint32_t x, uint32_t count) {
    for (; count >= kLanes; count -= kLanes, x += kLanes, at += kLanes * texel_bytes(kPixels))
      add<kConverts, kCovers>(at, x, kLanes);
    if (count > 0) add<kConverts, kCovers>(PartOfRow<kPixels>(at, 0, count).bytes, x, count);
  }

  template <bool kConverts, bool kCovers>
  HWY_INLINE void add(const std::byte* at, uint32_t x, uint32_t count) {
    const MF here = first_pixels(count);
    const Pixels wire = load_pixels<kPixels>(at);
    note_wire<kConverts>(wire, x, here);
    const Input as_it_is{input.frame, kPixels, false, false};
    const Pixels scene = ingest(kConverts ? input : as_it_is, wire);
    if (kConverts && input.matrix) {
      sums.negative_scene_components += negatives(scene, here);
      sums.max_magnitude = hn::Max(sums.max_magnitude, magnitude(ingest_unrounded(input, wire)));
    }
    const VF l = luminance(scene.r, scene.g, scene.b);
    add_metered(hn::Sub(fixed_log2(l), hn::Set(kUints, kLog2Offset)), weights<kCovers>(x, scene.a, here),
                metered<kConverts>(wire, l, here));
    sums.max_luminance = hn::Max(sums.max_luminance, bits(l));
    sums.min_luminance = hn::Min(sums.min_luminance, bits(l));
    const VF light =
        luminance(without_negatives(scene.r), without_negatives(scene.g), without_negatives(scene.b));
    sums.max_light = hn::Max(sums.max_light, bits(light));
  }

  static HWY_INLINE uint32_t negatives(const Pixels& c, MF here) {
    const VI any = hn::Or(hn::Or(bits(c.r), bits(c.g)), bits(c.b));
    if (hn::AllFalse(kInts, hn::Lt(any, hn::Zero(kInts)))) return 0;
    const VF zero = hn::Zero(kFloats);
    return count_of(hn::And(here, hn::Lt(c.r, zero))) + count_of(hn::And(here, hn::Lt(c.g, zero))) +
           count_of(hn::And(here, hn::Lt(c.b, zero)));
  }

  template <bool kConverts>
  HWY_INLINE void note_wire(const Pixels& wire, uint32_t x, MF here) {
    sums.negative_components += negatives(wire, here);
    VI largest = magnitude(wire);
    if (kConverts && work.constants.scrub != 0) count_bad(wire, x, here);
    if (work.constants.alpha != shader::METER_OPAQUE) {
      largest = hn::Max(largest, size(wire.a));
    } else {
      sums.alpha_differs |= !hn::AllTrue(kInts, hn::Eq(bits(wire.a), bits(set(1.0f))));
    }
    sums.max_magnitude = hn::Max(sums.max_magnitude, largest);
  }

  static HWY_INLINE VI size(VF c) { return hn::And(bits(c), hn::Set(kInts, 0x7fffffff)); }
  static HWY_INLINE VI magnitude(const Pixels& c) {
    return hn::Max(hn::Max(size(c.r), size(c.g)), size(c.b));
  }

  void count_bad(const Pixels& wire, uint32_t x, MF here) {
    const VI most = bits(set(shader::MAX_LIGHT));
    const Pixels scene = ingest_unclamped(input, wire);
    if (hn::AllFalse(kInts, hn::Gt(hn::Max(magnitude(wire), magnitude(scene)), most))) return;
    MF bad = hn::Xor(here, here);
    const auto count_clamped = [&](VF c) HWY_ATTR {
      const auto beyond = hn::And(hn::Gt(size(c), most), hn::Lt(size(c), hn::Set(kInts, kInfinity)));
      const MF clamped = hn::And(here, hn::RebindMask(kFloats, beyond));
      sums.clamped_components += count_of(clamped);
      bad = hn::Or(bad, clamped);
    };
    for (const VF c : {wire.r, wire.g, wire.b}) {
      const MF nan = hn::And(here, hn::IsNaN(c));
      const MF infinite = hn::And(here, is_infinite(c));
      sums.nan_components += count_of(nan);
      sums.infinite_components += count_of(infinite);
      bad = hn::Or(bad, hn::Or(nan, infinite));
      count_clamped(c);
    }
    if (input.matrix) {
      for (const VF c : {scene.r, scene.g, scene.b}) count_clamped(c);
    }
    if (hn::AllFalse(kFloats, bad)) return;
    const VU pixel = hn::LoadU(kUints, kPixelOfLane.data());
    const VU positions = hn::IfThenElse(hn::RebindMask(kUints, bad), pixel, hn::Set(kUints, kTileTexels));
    const uint32_t first = hn::GetLane(hn::MinOfLanes(kUints, positions));
    sums.first_bad_texel = std::min(sums.first_bad_texel, y * work.params.frame.width + x + first);
  }

  // The texels that are neither too dark nor absent.
  template <bool kConverts>
  HWY_INLINE MF metered(const Pixels& wire, VF l, MF here) {
    MF mask = here;
    if (work.constants.ignore != 0) {
      const auto dark = hn::Lt(bits(l), bits(set(work.params.ignore_below)));  // a negative one is, too
      mask = hn::AndNot(hn::RebindMask(kFloats, dark), mask);
    }
    if (work.constants.alpha != shader::METER_OPAQUE) {
      const Pixels c = kConverts && input.scrub ? scrub(wire) : wire;
      const VI light = hn::Or(hn::Or(bits(c.r), bits(c.g)), bits(c.b));
      const auto missing =
          hn::And(hn::Eq(hn::Add(light, light), hn::Zero(kInts)), hn::Lt(bits(c.a), hn::Set(kInts, 1)));
      const MF absent = hn::And(here, hn::RebindMask(kFloats, missing));
      sums.absent_texels += count_of(absent);
      mask = hn::AndNot(absent, mask);
    }
    return mask;
  }

  HWY_INLINE void add_metered(VU fixed, VU whole_weight, MF mask) {
    const VU weight = hn::IfThenElseZero(hn::RebindMask(kUints, mask), whole_weight);
    log2_low = hn::Add(log2_low, hn::Mul(hn::And(fixed, hn::Set(kUints, 0xffff)), weight));
    log2_high = hn::Add(log2_high, hn::Mul(hn::ShiftRight<16>(fixed), weight));
    sums.weight_sum = hn::Add(sums.weight_sum, weight);
    if (bins != nullptr) add_to_bins(fixed, weight);
  }

  template <bool kCovers>
  HWY_INLINE VU weights(uint32_t x, VF alpha, MF here) {
    const VU weight = weights(x);
    if (kCovers && work.constants.alpha == shader::METER_COVERAGE) return covered(weight, alpha, here);
    return weight;
  }

  // Of texels that alpha covers in part. Without WEIGHTS_CENTER a weight of 1 stands as 255.
  HWY_INLINE VU covered(VU weight, VF alpha, MF here) {
    const VF part = floats(hn::Min(hn::Max(bits(alpha), hn::Zero(kInts)), bits(set(1.0f))));
    const VI code = truncate_small(hn::Add(hn::Mul(part, set(255.0f)), set(0.5f)));
    const VI seen = hn::IfThenElseZero(hn::RebindMask(kInts, here), code);
    if (!hn::AllTrue(kInts, hn::Eq(seen, hn::Zero(kInts)))) sums.coverage |= 1;
    if (!hn::AllTrue(kInts, hn::Or(hn::Eq(seen, hn::Zero(kInts)), hn::Eq(seen, hn::Set(kInts, 255))))) {
      sums.coverage |= 2;
    }
    const VU product = hn::Mul(hn::BitCast(kUints, code), weight);
    if (work.constants.weights != shader::WEIGHTS_CENTER) return product;
    // product / 255, rounded, for products below 65535 - 127
    const VU shifted = hn::Add(product, hn::Set(kUints, 127));
    return hn::ShiftRight<8>(hn::Add(hn::Add(shifted, hn::Set(kUints, 1)), hn::ShiftRight<8>(shifted)));
  }

  HWY_INLINE VU weights(uint32_t x) const {
    if (work.constants.weights == shader::WEIGHTS_AVERAGE) return hn::Set(kUints, 1);
    const VI column = hn::Add(hn::BitCast(kInts, hn::LoadU(kUints, kPixelOfLane.data())),
                              hn::Set(kInts, static_cast<int32_t>(x)));
    if (work.constants.weights == shader::WEIGHTS_CENTER) return center_weights(column);
    const shader::IngestParams& p = work.params;
    if (y < p.spot_y0 || y >= p.spot_y1) return hn::Zero(kUints);
    const auto edge = [&](uint32_t at) HWY_ATTR {
      return hn::Set(kInts, static_cast<int32_t>(std::min(at, p.frame.width)));
    };
    const auto outside =
        hn::Or(hn::Lt(column, edge(p.spot_x0)), hn::Lt(edge(p.spot_x1), hn::Add(column, hn::Set(kInts, 1))));
    return hn::BitCast(kUints, hn::IfThenElse(outside, hn::Zero(kInts), hn::Set(kInts, 1)));
  }

  // The step floor(256 d2 / whole), with d2 the squared distance to the centre in half texels and whole that
  // of a corner, both below 2^30: an estimate in float, which is off by 1 at most, and what it leaves over.
  HWY_INLINE VU center_weights(VI column) const {
    const auto width = static_cast<int32_t>(work.params.frame.width);
    const auto height = static_cast<int32_t>(work.params.frame.height);
    const int32_t whole = width * width + height * height;
    const int32_t dy = 2 * static_cast<int32_t>(y) + 1 - height;
    const VI dx = hn::Add(hn::Add(column, column), hn::Set(kInts, 1 - width));
    const VI d2 = hn::Add(hn::Mul(dx, dx), hn::Set(kInts, dy * dy));
    const VF scale = set(256.0f / static_cast<float>(whole));
    VI step = truncate_small(hn::Mul(hn::ConvertTo(kFloats, d2), scale));
    // Modulo 2^32, which is enough for a number between -whole and 2 whole.
    const VI rest =
        hn::Sub(hn::ShiftLeft<shader::CENTER_STEPS_LOG2>(d2), hn::Mul(step, hn::Set(kInts, whole)));
    step = hn::Add(step, hn::VecFromMask(kInts, hn::Lt(rest, hn::Zero(kInts))));
    step = hn::Sub(step, hn::VecFromMask(kInts, hn::Gt(rest, hn::Set(kInts, whole - 1))));
    // Beyond the frame's right edge there are more steps than weights.
    step = hn::Min(step, hn::Set(kInts, (1 << shader::CENTER_STEPS_LOG2) - 1));
    return hn::GatherIndex(kUints, work.center_weights.data(), step);
  }

  HWY_INLINE void add_to_bins(VU fixed, VU weight) {
    HWY_ALIGN std::array<uint32_t, kLanes> values;
    HWY_ALIGN std::array<uint32_t, kLanes> weights_of;
    hn::Store(fixed, kUints, values.data());
    hn::Store(weight, kUints, weights_of.data());
    const bool centered = work.constants.weights == shader::WEIGHTS_CENTER;
    const bool covers = work.constants.alpha == shader::METER_COVERAGE;
    for (size_t i = 0; i < kLanes; ++i) {
      if (weights_of[i] == 0) continue;
      const uint32_t bin = std::min(values[i] >> shader::HISTOGRAM_SHIFT, bins->count() - 1);
      const uint32_t above = values[i] - (bin << shader::HISTOGRAM_SHIFT);
      const uint32_t offset = centered ? (above * weights_of[i] + 128) >> 8
                              : covers ? (above * weights_of[i] + 127) / 255
                                       : above;
      (*bins)[bin] += uint64_t{weights_of[i]} << 32 | offset;
    }
  }
};

namespace {

template <typename V>
uint32_t largest(V v) {
  return static_cast<uint32_t>(hn::GetLane(hn::MaxOfLanes(hn::DFromV<V>(), v)));
}

shader::TileRecord record_of(const TileSums& sums, const shader::IngestConstants& constants) {
  const bool sums_weights =
      constants.weights != shader::WEIGHTS_AVERAGE || constants.ignore != 0 || constants.alpha != 0;
  const uint64_t log2_sum = hn::GetLane(hn::SumOfLanes(kLongs, sums.log2_sum));
  const int32_t darkest = hn::GetLane(hn::MinOfLanes(kInts, sums.min_luminance));
  shader::TileRecord record{};
  record.log2_sum_low = static_cast<uint32_t>(log2_sum & 0xffff);
  record.log2_sum_high = static_cast<uint32_t>(log2_sum >> 16);
  if (sums_weights) record.weight_sum = hn::GetLane(hn::SumOfLanes(kUints, sums.weight_sum));
  record.max_luminance_bits = largest(sums.max_luminance);
  record.min_luminance_bits_inverted = ~static_cast<uint32_t>(std::max(darkest, 0));
  record.max_magnitude_bits = largest(sums.max_magnitude);
  record.negative_components = sums.negative_components;
  if (constants.light != 0) record.max_light_bits = largest(sums.max_light);
  record.nan_components = sums.nan_components;
  record.infinite_components = sums.infinite_components;
  record.clamped_components = sums.clamped_components;
  record.first_bad_texel_inverted = ~sums.first_bad_texel;
  record.negative_scene_components = sums.negative_scene_components;
  record.alpha_differs = sums.alpha_differs;
  record.absent_texels = sums.absent_texels;
  record.coverage = sums.coverage;
  return record;
}

// Copies serve several rows of tiles, so other threads add to them, too.
void add_bins(const Bins& bins, shader::HistogramBin* copy) {
  for (size_t i = 0; i < bins.count(); ++i) {
    if (bins[i] == 0) continue;
    std::atomic_ref(copy[i].weight)
        .fetch_add(static_cast<uint32_t>(bins[i] >> 32), std::memory_order_relaxed);
    std::atomic_ref(copy[i].offset_sum).fetch_add(static_cast<uint32_t>(bins[i]), std::memory_order_relaxed);
  }
}

// Tiles that are read together: their sums stay in the first cache.
constexpr uint32_t kTilesAtOnce = 32;
static_assert(shader::HISTOGRAM_TILES % kTilesAtOnce == 0);

// Meters tiles `first` to `last` - 1 of a row of tiles.
template <uint32_t kPixels>
void meter_tiles(const IngestWork& work, uint32_t tile_row, uint32_t first, uint32_t last, Bins* bins) {
  const shader::IngestConstants& constants = work.constants;
  const shader::InputParams& frame = work.params.frame;
  const Input input = {frame, kPixels, constants.matrix != 0, constants.scrub != 0};
  const bool may_be_plain = !input.matrix && !input.scrub && constants.weights == shader::WEIGHTS_AVERAGE &&
                            constants.ignore == 0 && constants.alpha == 0 && bins == nullptr;
  const Input plain_input = {frame, kPixels, false, false};
  std::array<TileSums, kTilesAtOnce> sums;
  const uint32_t rows_end = std::min((tile_row + 1) * kTileTexels, frame.height);
  for (uint32_t y = tile_row * kTileTexels; y < rows_end; ++y) {
    for (uint32_t tile = first; tile < last; ++tile) {
      const uint32_t x = tile * kTileTexels;
      const uint32_t count = std::min(kTileTexels, frame.width - x);
      const std::byte* at = work.wire + (size_t{y} * frame.input_pitch + x) * texel_bytes(kPixels);
      if (may_be_plain && PlainRun<kPixels>(plain_input).meter(at, count, sums[tile - first])) continue;
      AnyRun<kPixels>(work, input, bins, y, sums[tile - first]).meter(at, x, count);
    }
  }
  shader::TileRecord* records = work.tiles + size_t{tile_row} * work.params.tiles_x;
  for (uint32_t tile = first; tile < last; ++tile) records[tile] = record_of(sums[tile - first], constants);
}

template <uint32_t kPixels>
void meter_row(const IngestWork& work, uint32_t tile_row) {
  for (uint32_t tile = 0; tile < work.params.tiles_x;) {
    const uint32_t index = tile_row * work.params.tiles_x + tile;
    // Up to the next copy of the histogram.
    const uint32_t last = std::min(work.params.tiles_x, tile + kTilesAtOnce - index % kTilesAtOnce);
    if (work.histogram == nullptr) {
      meter_tiles<kPixels>(work, tile_row, tile, last, nullptr);
    } else {
      Bins bins(histogram_bins(work.constants.scrub != 0));
      meter_tiles<kPixels>(work, tile_row, tile, last, &bins);
      add_bins(bins, work.histogram + size_t{index / shader::HISTOGRAM_TILES} * bins.count());
    }
    tile = last;
  }
}

}  // namespace

#endif  // CANDELA_HOST_TARGET

void ingest_tiles_here([[maybe_unused]] const IngestWork& work, [[maybe_unused]] uint32_t tile_row) {
#if CANDELA_HOST_TARGET
  switch (work.constants.pixels) {
    case shader::PIXELS_RGBA16F:
      return meter_row<shader::PIXELS_RGBA16F>(work, tile_row);
    case shader::PIXELS_RGBA32F:
      return meter_row<shader::PIXELS_RGBA32F>(work, tile_row);
    default:
      return meter_row<shader::PIXELS_RGB9E5>(work, tile_row);
  }
#endif
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(ingest_tiles_here);

void ingest_tiles(const IngestWork& work, uint32_t tile_row) {
  HWY_DYNAMIC_DISPATCH(ingest_tiles_here)(work, tile_row);
}

}  // namespace candela::host
#endif
