// How ingest adds up a tile's part of a row, whatever it holds and whatever is asked, for each target of
// Highway.
#if defined(CANDELA_HOST_ANY_RUN_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_ANY_RUN_INL_H
#undef CANDELA_HOST_ANY_RUN_INL_H
#else
#define CANDELA_HOST_ANY_RUN_INL_H
#endif

#include <algorithm>
#include <array>

#include "server/render/host/ingest/ingest_tiles.h"
#include "server/render/host/ingest/tile_sums-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

#if CANDELA_HOST_TARGET

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

#endif  // CANDELA_HOST_TARGET

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
