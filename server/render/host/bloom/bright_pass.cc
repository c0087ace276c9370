// Bloom, level 0 from the frame (shaders/bloom/bright_pass.comp), for each target of Highway.
//
// A vector holds as many texels of D_0, which come from twice as many pixels of two rows. With a level size
// of 4, two rows of D_0 are made first, and then their means.
#include "server/render/host/lanes/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/bloom/bright_pass.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>

#include "server/render/host/bloom/bloom_passes.h"
#include "server/render/host/lanes/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

#if CANDELA_HOST_TARGET

namespace {

struct Rgb {
  VF r, g, b;
};

HWY_INLINE VF fused_luminance(const Rgb& c) {
  return hn::MulAdd(set(0.0722f), c.b, hn::MulAdd(set(0.7152f), c.g, hn::Mul(set(0.2126f), c.r)));
}

// The pixels at even and at odd columns of two vectors. Both results have the same order, which
// natural_pairs() undoes.
HWY_INLINE void separate(VF first, VF second, VF& even, VF& odd) {
#if HWY_TARGET == HWY_AVX3
  even = VF{_mm512_shuffle_f32x4(first.raw, second.raw, 0x88)};
  odd = VF{_mm512_shuffle_f32x4(first.raw, second.raw, 0xdd)};
#else
  if constexpr (kBlocks == 2) {
    even = hn::ConcatLowerLower(kFloats, second, first);
    odd = hn::ConcatUpperUpper(kFloats, second, first);
  } else {
    even = hn::ConcatEven(kFloats, second, first);
    odd = hn::ConcatOdd(kFloats, second, first);
  }
#endif
}

// Only sixteen lanes come out of separate() in another order: each half as 0 2 4 6 1 3 5 7.
HWY_INLINE VF natural_pairs(VF v) {
  if constexpr (kBlocks != 4) return v;
  constexpr auto kLanesOfPairs = [] {
    std::array<int32_t, kLanes> lanes{};
    for (size_t i = 0; i < kLanes; ++i) lanes[i] = static_cast<int32_t>(i / 8 * 8 + i % 2 * 4 + i % 8 / 2);
    return lanes;
  }();
  return hn::TableLookupLanes(v, hn::SetTableIndices(kFloats, kLanesOfPairs.data()));
}

// Two rows of kLanes blocks of 2x2 pixels: a b above, c d below.
struct Blocks {
  Rgb a, b, c, d;
};

// 2 * kLanes pixels of a row, negatives cut to 0.
template <uint32_t kPixels>
HWY_INLINE void load_pairs(const Input& input, const std::byte* at, Rgb& even, Rgb& odd) {
  const Pixels first = ingest(input, load_pixels<kPixels>(at));
  const Pixels second = ingest(input, load_pixels<kPixels>(at + kLanes * texel_bytes(kPixels)));
  separate(without_negatives(first.r), without_negatives(second.r), even.r, odd.r);
  separate(without_negatives(first.g), without_negatives(second.g), even.g, odd.g);
  separate(without_negatives(first.b), without_negatives(second.b), even.b, odd.b);
}

// Component by component.
template <typename F>
HWY_INLINE Rgb each(const Rgb& a, const Rgb& b, const Rgb& c, const Rgb& d, const F& f) {
  return {f(a.r, b.r, c.r, d.r), f(a.g, b.g, c.g, d.g), f(a.b, b.b, c.b, d.b)};
}

HWY_INLINE Rgb scaled(const Rgb& c, VF by) { return {hn::Mul(c.r, by), hn::Mul(c.g, by), hn::Mul(c.b, by)}; }

HWY_INLINE Rgb plain_mean(const Blocks& p) {
  return each(p.a, p.b, p.c, p.d, [](VF a, VF b, VF c, VF d) HWY_ATTR {
    return hn::Mul(set(0.25f), hn::Add(hn::Add(a, b), hn::Add(c, d)));
  });
}

// The mean with weights 1 / (1 + L). Each weight is multiplied by all four (1 + L), which cancels out and
// leaves one division instead of five. At most 2^30 to the fourth: no overflow.
HWY_INLINE Rgb firefly_mean(const Blocks& p) {
  const VF one = set(1.0f);
  const VF a = hn::Add(one, fused_luminance(p.a));
  const VF b = hn::Add(one, fused_luminance(p.b));
  const VF c = hn::Add(one, fused_luminance(p.c));
  const VF d = hn::Add(one, fused_luminance(p.d));
  const VF ab = hn::Mul(a, b);
  const VF cd = hn::Mul(c, d);
  const VF wa = hn::Mul(b, cd);
  const VF wb = hn::Mul(a, cd);
  const VF wc = hn::Mul(d, ab);
  const VF wd = hn::Mul(c, ab);
  const VF scale = hn::Div(one, hn::Add(hn::Add(wa, wb), hn::Add(wc, wd)));
  const Rgb sum = each(p.a, p.b, p.c, p.d, [&](VF va, VF vb, VF vc, VF vd) HWY_ATTR {
    return hn::MulAdd(wd, vd, hn::MulAdd(wc, vc, hn::MulAdd(wb, vb, hn::Mul(wa, va))));
  });
  return scaled(sum, scale);
}

template <uint32_t kPixels>
class BrightPass {
 public:
  explicit BrightPass(const BrightWork& work)
      : work_(work),
        input_{work.params.frame, kPixels, work.constants.matrix != 0, work.constants.scrub != 0},
        box_(work.constants.bloom != shader::BLOOM_MIP),
        over_knees_(work.params.knee > 0 ? 1.0f / (4.0f * work.params.knee) : 0.0f) {}

  void run(const LevelPlanes& to, const Box& box) const {
    for (uint32_t y = box.y0; y < box.y1; ++y) {
      if (work_.constants.level_size == 2) {
        make_d0(y, box.x0, box.x1, {to.row(y, 0) + box.x0, to.row(y, 1) + box.x0, to.row(y, 2) + box.x0});
      } else {
        make_quarter_row(to, y, box.x0, box.x1);
      }
    }
  }

 private:
  // R, G and B of a row.
  using Row = std::array<float*, 3>;

  const std::byte* wire_row(uint32_t y) const {
    const shader::InputParams& frame = work_.params.frame;
    return work_.wire + size_t{std::min(y, frame.height - 1)} * frame.input_pitch * texel_bytes(kPixels);
  }

  // Texels x0 to x1 - 1 of row y of D_0; beyond the frame's edges pixels repeat.
  void make_d0(uint32_t y, uint32_t x0, uint32_t x1, const Row& out) const {
    const uint32_t width = work_.params.frame.width;
    const std::byte* top = wire_row(2 * y);
    const std::byte* bottom = wire_row(2 * y + 1);
    for (uint32_t x = x0; x < x1; x += kLanes) {
      Blocks blocks;
      if (2 * (x + kLanes) <= width) {
        load_pairs<kPixels>(input_, top + 2 * x * texel_bytes(kPixels), blocks.a, blocks.b);
        load_pairs<kPixels>(input_, bottom + 2 * x * texel_bytes(kPixels), blocks.c, blocks.d);
      } else {
        load_pairs<kPixels>(input_, PartOfRow<kPixels, 2 * kLanes>(top, 2 * x, width).bytes, blocks.a,
                            blocks.b);
        load_pairs<kPixels>(input_, PartOfRow<kPixels, 2 * kLanes>(bottom, 2 * x, width).bytes, blocks.c,
                            blocks.d);
      }
      const Rgb d0 = bright(blocks);
      store(natural_pairs(d0.r), out[0] + (x - x0), x1 - x);
      store(natural_pairs(d0.g), out[1] + (x - x0), x1 - x);
      store(natural_pairs(d0.b), out[2] + (x - x0), x1 - x);
    }
  }

  HWY_INLINE Rgb bright(const Blocks& blocks) const {
    if (box_) return plain_mean(blocks);
    const Rgb mean = work_.constants.firefly_weights != 0 ? firefly_mean(blocks) : plain_mean(blocks);
    const VF l = fused_luminance(mean);
    const VF over = hn::Sub(l, set(work_.params.threshold));
    const VF knee = set(work_.params.knee);
    const VF soft = hn::Min(hn::Max(hn::Add(over, knee), hn::Zero(kFloats)), hn::Add(knee, knee));
    const VF q = hn::Mul(hn::Mul(soft, soft), set(over_knees_));
    return scaled(mean, hn::Div(hn::Max(over, q), hn::Max(l, set(shader::MIN_METERED_LUMINANCE))));
  }

  // A row of a level with one texel for 2x2 of D_0.
  void make_quarter_row(const LevelPlanes& to, uint32_t y, uint32_t x0, uint32_t x1) const {
    const bool blurs = work_.constants.bloom == shader::BLOOM_GAUSSIAN;
    const uint32_t d0_width = (work_.params.frame.width + 1) / 2;
    const uint32_t d0_height = (work_.params.frame.height + 1) / 2;
    // GAUSSIAN repeats the frame's last row and column, the others those of D_0.
    const uint32_t below = blurs || 2 * y + 1 < d0_height ? 2 * y + 1 : 2 * y;
    for (uint32_t first = x0; first < x1; first += kTexels) {
      const uint32_t last = std::min(first + kTexels, x1);
      HWY_ALIGN float d0[2][3][2 * kTexels];
      make_d0(2 * y, 2 * first, 2 * last, {d0[0][0], d0[0][1], d0[0][2]});
      make_d0(below, 2 * first, 2 * last, {d0[1][0], d0[1][1], d0[1][2]});
      if (!blurs && 2 * last > d0_width) {
        for (auto& row : d0) {
          for (float* plane : row) plane[d0_width - 2 * first] = plane[d0_width - 2 * first - 1];
        }
      }
      for (uint32_t x = first; x < last; x += kLanes) {
        Rgb mean = {quarter(d0[0][0], d0[1][0], x - first), quarter(d0[0][1], d0[1][1], x - first),
                    quarter(d0[0][2], d0[1][2], x - first)};
        if (blurs) mean = over_threshold(mean);
        store(mean.r, to.row(y, 0) + x, last - x);
        store(mean.g, to.row(y, 1) + x, last - x);
        store(mean.b, to.row(y, 2) + x, last - x);
      }
    }
  }

  static HWY_INLINE VF quarter(const float* top, const float* bottom, size_t x) {
    const auto rows = [&](size_t at) HWY_ATTR {
      return hn::Add(hn::Load(kFloats, top + at), hn::Load(kFloats, bottom + at));
    };
    const VF first = rows(2 * x);
    const VF second = rows(2 * x + kLanes);
    return hn::Mul(set(0.25f),
                   hn::Add(hn::ConcatEven(kFloats, second, first), hn::ConcatOdd(kFloats, second, first)));
  }

  // GAUSSIAN's threshold.
  HWY_INLINE Rgb over_threshold(const Rgb& mean) const {
    const VF over = hn::Sub(fused_luminance(mean), set(work_.params.threshold));
    return scaled(mean, hn::Min(hn::Max(over, hn::Zero(kFloats)), set(1.0f)));
  }

  // Of a level with a size of 4, made at once.
  static constexpr uint32_t kTexels = 128;

  const BrightWork& work_;
  const Input input_;
  const bool box_;  // D_0 is the mean and no more
  const float over_knees_;
};

}  // namespace

#endif  // CANDELA_HOST_TARGET

void bright_pass_here([[maybe_unused]] const BrightWork& work, [[maybe_unused]] const LevelPlanes& to,
                      [[maybe_unused]] const Box& box) {
#if CANDELA_HOST_TARGET
  switch (work.constants.pixels) {
    case shader::PIXELS_RGBA16F:
      return BrightPass<shader::PIXELS_RGBA16F>(work).run(to, box);
    case shader::PIXELS_RGBA32F:
      return BrightPass<shader::PIXELS_RGBA32F>(work).run(to, box);
    default:
      return BrightPass<shader::PIXELS_RGB9E5>(work).run(to, box);
  }
#endif
}

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(bright_pass_here);

void bright_pass(const BrightWork& work, const LevelPlanes& to, const Box& box) {
  HWY_DYNAMIC_DISPATCH(bright_pass_here)(work, to, box);
}

}  // namespace candela::host
#endif
