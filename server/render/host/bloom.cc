// Bloom on the host, for each target of Highway, and on a crew of threads.
#include "server/render/host/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/bloom.cc"
#include <hwy/foreach_target.h>
// Only after foreach_target.h.
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <variant>

#include "server/base/check.h"
#include "server/render/host/bloom.h"
#include "server/render/host/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

// Bloom, level 0 from the frame (shaders/bloom/bright_pass.comp), for each target of Highway.
//
// A vector holds as many texels of D_0, which come from twice as many pixels of two rows. With a level size
// of 4, two rows of D_0 are made first, and then their means.

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

// Bloom, from level to level (shaders/bloom/bloom_down.comp, bloom_up.comp, gaussian.comp), for each target
// of Highway.
//
// Every pass filters columns first, from the rows of a level into a strip of floats, and then that strip
// along the row. Strips are a few hundred columns, so that they and the rows that they come from stay in the
// first cache while the pass walks down.

#if CANDELA_HOST_TARGET

namespace {

// Texels of the written level that are made from one strip.
constexpr uint32_t kTexels = 512;

// Columns of a filtered row and a margin on either side. Floats that no column fills are 0.
template <size_t kColumns>
struct Strip {
  static constexpr int64_t kMargin = 2 * kLanes;
  HWY_ALIGN std::array<float, kColumns + 2 * kMargin + kLanes> floats{};

  // The column at `offset` from `begin`.
  HWY_INLINE float* at(int64_t offset) { return floats.data() + kMargin + offset; }

  // Fills the columns from begin - reach to end + reach - 1: those in the row by filter(column), a vector at
  // a time, and those beyond with what is at its ends.
  template <typename Filter>
  HWY_INLINE void fill(int64_t begin, int64_t end, int64_t reach, int64_t width, const Filter& filter) {
    const auto lanes = static_cast<int64_t>(kLanes);
    // From a whole vector on, and to the end of one where the row goes on.
    int64_t x = std::max<int64_t>(0, begin - (reach + lanes - 1) / lanes * lanes);
    const int64_t last = std::min(end + reach, width);
    const int64_t last_whole = std::min(last, width - lanes + 1);
    for (; x < last_whole; x += lanes) hn::Store(filter(x, Whole()), kFloats, at(x - begin));
    if (x < last) hn::Store(filter(x, Part{static_cast<size_t>(width - x)}), kFloats, at(x - begin));
    if (begin == 0) std::fill(at(-reach), at(0), *at(0));
    if (end + reach > width) std::fill(at(width - begin), at(end + reach - begin), *at(width - 1 - begin));
  }

  // How much of a vector a filter loads.
  struct Whole {
    HWY_INLINE VF load(const float* from) const { return hn::LoadU(kFloats, from); }
  };
  struct Part {
    size_t count;
    HWY_INLINE VF load(const float* from) const { return load_some(from, count); }
  };
};

// Row y of a component, or the nearest one.
HWY_INLINE const float* clamped_row(const LevelPlanes& level, int64_t y, size_t component) {
  return level.row(static_cast<size_t>(std::clamp<int64_t>(y, 0, int64_t{level.height} - 1)), component);
}

// Calls strip(x0, x1, component) for strips of the box.
template <typename F>
void each_strip(const Box& box, const F& strip) {
  for (uint32_t x = box.x0; x < box.x1; x += kTexels) {
    for (size_t component = 0; component < 3; ++component) strip(x, std::min(x + kTexels, box.x1), component);
  }
}

// Thirteen taps are the sum of two separable filters (shaders/bloom/bloom_down.comp): even = (1 1 2 2 1 1)
// and odd = (0 1 1 1 1 0). With H = even / 128 down a column and G = H + odd / 32 down the same one, texel x
// is
//   H[2x-2] + G[2x-1] + G[2x] + H[2x] + H[2x+1] + G[2x+1] + G[2x+2] + H[2x+3].
class Down {
 public:
  Down(const LevelPlanes& from, const LevelPlanes& to) : from_(from), to_(to) {}

  void rows(const Box& box, uint32_t x0, uint32_t x1, size_t component) {
    for (uint32_t y = box.y0; y < box.y1; ++y) {
      filter_columns(y, x0, x1, component);
      pair_up(x1 - x0);
      float* out = to_.row(y, component) + x0;
      for (uint32_t x = 0; x < x1 - x0; x += kLanes) {
        const VF left = hn::Add(hn::LoadU(kFloats, left_.at(int64_t{x} - 1)), hn::Load(kFloats, left_.at(x)));
        const VF right =
            hn::Add(hn::Load(kFloats, right_.at(x)), hn::LoadU(kFloats, right_.at(int64_t{x} + 1)));
        store(hn::Add(left, right), out + x, x1 - x0 - x);
      }
    }
  }

 private:
  HWY_INLINE void filter_columns(uint32_t y, uint32_t x0, uint32_t x1, size_t component) {
    const float* r[6];
    for (int i = 0; i < 6; ++i) r[i] = clamped_row(from_, 2 * int64_t{y} - 2 + i, component);
    const int64_t begin = 2 * int64_t{x0};
    h_.fill(begin, 2 * int64_t{x1}, 2, from_.width, [&](int64_t x, auto part) HWY_ATTR {
      const VF inner = hn::Add(part.load(r[2] + x), part.load(r[3] + x));
      const VF outer = hn::Add(part.load(r[1] + x), part.load(r[4] + x));
      const VF ends = hn::Add(part.load(r[0] + x), part.load(r[5] + x));
      const VF even = hn::Mul(set(1.0f / 128), hn::MulAdd(set(2.0f), inner, hn::Add(outer, ends)));
      const VF odd = hn::Add(inner, outer);
      hn::Store(hn::MulAdd(set(1.0f / 32), odd, even), kFloats, g_.at(x - begin));
      return even;
    });
    // G has the same ends.
    if (begin == 0) std::fill(g_.at(-2), g_.at(0), *g_.at(0));
    const int64_t end = std::min<int64_t>(2 * int64_t{x1} + 2, from_.width);
    std::fill(g_.at(end - begin), g_.at(2 * int64_t{x1} + 2 - begin), *g_.at(end - 1 - begin));
  }

  // H[2k] + G[2k+1] to the left, G[2k] + H[2k+1] to the right.
  HWY_INLINE void pair_up(int64_t texels) {
    const auto lanes = static_cast<int64_t>(kLanes);
    for (int64_t k = -lanes; k <= texels; k += lanes) {
      const VF h0 = hn::Load(kFloats, h_.at(2 * k));
      const VF h1 = hn::Load(kFloats, h_.at(2 * k + lanes));
      const VF g0 = hn::Load(kFloats, g_.at(2 * k));
      const VF g1 = hn::Load(kFloats, g_.at(2 * k + lanes));
      hn::Store(hn::Add(hn::ConcatEven(kFloats, h1, h0), hn::ConcatOdd(kFloats, g1, g0)), kFloats,
                left_.at(k));
      hn::Store(hn::Add(hn::ConcatEven(kFloats, g1, g0), hn::ConcatOdd(kFloats, h1, h0)), kFloats,
                right_.at(k));
    }
  }

  const LevelPlanes& from_;
  const LevelPlanes& to_;
  Strip<2 * kTexels> h_;
  Strip<2 * kTexels> g_;
  Strip<kTexels> left_;
  Strip<kTexels> right_;
};

// The tent over bilinear samples is a filter of four taps along each axis (shaders/bloom/bloom_up.comp): (1 5
// 7 3)/16 from x - 2 on for even texels and (3 7 5 1)/16 from x - 1 on for odd ones.
class Up {
 public:
  Up(const LevelPlanes& from, const LevelPlanes& to, float fine_weight)
      : from_(from), to_(to), fine_weight_(fine_weight) {}

  void rows(const Box& box, uint32_t x0, uint32_t x1, size_t component) {
    const VF weight = set(fine_weight_);
    for (uint32_t y = box.y0; y < box.y1; ++y) {
      filter_columns(y, x0 / 2, (x1 + 1) / 2, component);
      filter_row((x1 + 1) / 2 - x0 / 2);
      float* out = to_.row(y, component) + x0;
      uint32_t x = 0;
      for (; x + kLanes <= x1 - x0; x += kLanes) {
        hn::StoreU(hn::MulAdd(weight, hn::LoadU(kFloats, out + x), hn::Load(kFloats, fine_.at(x))), kFloats,
                   out + x);
      }
      if (const size_t rest = x1 - x0 - x; rest != 0) {
        store_some(hn::MulAdd(weight, load_some(out + x, rest), hn::Load(kFloats, fine_.at(x))), out + x,
                   rest);
      }
    }
  }

 private:
  static HWY_INLINE VF taps(VF a, VF b, VF c, VF d) {
    const VF ab = hn::MulAdd(set(5.0f / 16), b, hn::Mul(set(1.0f / 16), a));
    return hn::MulAdd(set(3.0f / 16), d, hn::MulAdd(set(7.0f / 16), c, ab));
  }

  HWY_INLINE void filter_columns(uint32_t y, uint32_t x0, uint32_t x1, size_t component) {
    // Odd rows have the taps in the other order.
    const int64_t first = int64_t{y / 2} + (y % 2 == 0 ? -2 : 2);
    const int64_t step = y % 2 == 0 ? 1 : -1;
    const float* r[4];
    for (int i = 0; i < 4; ++i) r[i] = clamped_row(from_, first + step * i, component);
    column_.fill(x0, x1, 2, from_.width, [&](int64_t x, auto part) HWY_ATTR {
      return taps(part.load(r[0] + x), part.load(r[1] + x), part.load(r[2] + x), part.load(r[3] + x));
    });
  }

  HWY_INLINE void filter_row(int64_t texels) {
    for (int64_t x = 0; x < texels; x += kLanes) {
      const VF t0 = hn::LoadU(kFloats, column_.at(x - 2));
      const VF t1 = hn::LoadU(kFloats, column_.at(x - 1));
      const VF t2 = hn::Load(kFloats, column_.at(x));
      const VF t3 = hn::LoadU(kFloats, column_.at(x + 1));
      const VF t4 = hn::LoadU(kFloats, column_.at(x + 2));
      hn::StoreInterleaved2(taps(t0, t1, t2, t3), taps(t4, t3, t2, t1), kFloats, fine_.at(2 * x));
    }
  }

  const LevelPlanes& from_;
  const LevelPlanes& to_;
  const float fine_weight_;
  Strip<kTexels / 2 + 1> column_;
  Strip<kTexels + 2> fine_;
};

// One direction of the separable kernel of thirteen taps (shaders/bloom/gaussian.comp), divided by its sum.
class Gaussian {
 public:
  Gaussian(const LevelPlanes& from, const LevelPlanes& to) : from_(from), to_(to) {}

  void down_columns(const Box& box, uint32_t x0, uint32_t x1, size_t component) {
    for (uint32_t y = box.y0; y < box.y1; ++y) {
      const float* r[2 * kReach + 1];
      for (int i = 0; i <= 2 * kReach; ++i) r[i] = clamped_row(from_, int64_t{y} - kReach + i, component);
      float* out = to_.row(y, component);
      for (uint32_t x = x0; x < x1; x += kLanes) {
        if (x + kLanes <= from_.width) {
          store(taps([&](int i) HWY_ATTR { return hn::LoadU(kFloats, r[kReach + i] + x); }), out + x, x1 - x);
        } else {
          const size_t rest = from_.width - x;
          store(taps([&](int i) HWY_ATTR { return load_some(r[kReach + i] + x, rest); }), out + x, x1 - x);
        }
      }
    }
  }

  void along_rows(const Box& box, uint32_t x0, uint32_t x1, size_t component) {
    for (uint32_t y = box.y0; y < box.y1; ++y) {
      const float* in = from_.row(y, component);
      row_.fill(x0, x1, kReach, from_.width,
                [&](int64_t x, auto part) HWY_ATTR { return part.load(in + x); });
      float* out = to_.row(y, component) + x0;
      for (uint32_t x = 0; x < x1 - x0; x += kLanes) {
        const VF sum = taps([&](int i) HWY_ATTR { return hn::LoadU(kFloats, row_.at(int64_t{x} + i)); });
        store(sum, out + x, x1 - x0 - x);
      }
    }
  }

 private:
  static constexpr int kReach = shader::GAUSSIAN_REACH;
  static constexpr double kSum = 0.998975;
  static constexpr float kTaps[] = {0.199471 / kSum, 0.176033 / kSum, 0.120985 / kSum, 0.064759 / kSum,
                                    0.026995 / kSum, 0.008764 / kSum, 0.002216 / kSum};

  template <typename Tap>
  static HWY_INLINE VF taps(const Tap& tap) {
    VF sum = hn::Mul(set(kTaps[0]), tap(0));
    for (int i = 1; i <= kReach; ++i) sum = hn::MulAdd(set(kTaps[i]), hn::Add(tap(-i), tap(i)), sum);
    return sum;
  }

  const LevelPlanes& from_;
  const LevelPlanes& to_;
  Strip<kTexels> row_;
};

}  // namespace

void bloom_down_here(const LevelPlanes& from, const LevelPlanes& to, const Box& box) {
  Down down(from, to);
  each_strip(box, [&](uint32_t x0, uint32_t x1, size_t component) { down.rows(box, x0, x1, component); });
}

void bloom_up_here(const LevelPlanes& from, const LevelPlanes& to, float fine_weight, const Box& box) {
  Up up(from, to, fine_weight);
  each_strip(box, [&](uint32_t x0, uint32_t x1, size_t component) { up.rows(box, x0, x1, component); });
}

void gaussian_here(const LevelPlanes& from, const LevelPlanes& to, bool vertical, const Box& box) {
  Gaussian blur(from, to);
  each_strip(box, [&](uint32_t x0, uint32_t x1, size_t component) {
    vertical ? blur.down_columns(box, x0, x1, component) : blur.along_rows(box, x0, x1, component);
  });
}

#else

void bloom_down_here(const LevelPlanes&, const LevelPlanes&, const Box&) {}
void bloom_up_here(const LevelPlanes&, const LevelPlanes&, float, const Box&) {}
void gaussian_here(const LevelPlanes&, const LevelPlanes&, bool, const Box&) {}

#endif  // CANDELA_HOST_TARGET

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace candela::host {

HWY_EXPORT(bright_pass_here);

void bright_pass(const BrightWork& work, const LevelPlanes& to, const Box& box) {
  HWY_DYNAMIC_DISPATCH(bright_pass_here)(work, to, box);
}

HWY_EXPORT(bloom_down_here);
HWY_EXPORT(bloom_up_here);
HWY_EXPORT(gaussian_here);

void bloom_down(const LevelPlanes& from, const LevelPlanes& to, const Box& box) {
  HWY_DYNAMIC_DISPATCH(bloom_down_here)(from, to, box);
}

void bloom_up(const LevelPlanes& from, const LevelPlanes& to, float fine_weight, const Box& box) {
  HWY_DYNAMIC_DISPATCH(bloom_up_here)(from, to, fine_weight, box);
}

void gaussian(const LevelPlanes& from, const LevelPlanes& to, bool vertical, const Box& box) {
  HWY_DYNAMIC_DISPATCH(gaussian_here)(from, to, vertical, box);
}

namespace {

// Texels that are worth waking a thread for, and parts for each thread, so that all end at about the same
// time. A slice ends between two parts, so none takes more than a few milliseconds.
constexpr uint64_t kTexelsOfPart = 4096;
constexpr uint64_t kMostTexelsOfPart = uint64_t{1} << 17;
constexpr uint64_t kPartsPerThread = 4;

// The boxes of a level that a step's work groups cover, in parts for `threads` threads.
std::vector<Box> parts_of(const BloomStep& step, const LevelPlanes& to, uint32_t threads) {
  std::vector<Box> boxes;
  uint64_t texels = 0;
  for (const Box& group : step.groups) {
    const Box box = {group.x0 * step.group_columns, group.y0 * step.group_rows,
                     std::min(group.x1 * step.group_columns, to.width),
                     std::min(group.y1 * step.group_rows, to.height)};
    CHECK(box.x0 < box.x1 && box.y0 < box.y1);
    boxes.push_back(box);
    texels += uint64_t{box.x1 - box.x0} * (box.y1 - box.y0);
  }
  const uint64_t part_texels =
      std::clamp(texels / (kPartsPerThread * threads), kTexelsOfPart, kMostTexelsOfPart);
  std::vector<Box> parts;
  for (const Box& box : boxes) {
    const auto rows = static_cast<uint32_t>(std::max<uint64_t>(1, part_texels / (box.x1 - box.x0)));
    for (uint32_t y = box.y0; y < box.y1; y += rows) {
      parts.push_back({box.x0, y, box.x1, std::min(y + rows, box.y1)});
    }
  }
  return parts;
}

using BrightInputs = ShaderInputs<shader::BrightPassConstants, shader::BrightPassParams>;
using UpInputs = ShaderInputs<shader::BloomUpConstants, shader::BloomLevelParams>;
using GaussianInputs = ShaderInputs<shader::GaussianConstants, shader::GaussianParams>;

void make_part(const BloomStep& step, const FrameTextures& textures, const LevelPlanes& to, const Box& part) {
  if (const auto* bright = std::get_if<BrightInputs>(&step.inputs)) {
    return bright_pass({bright->constants, bright->params, textures.input.buffer().mapped()}, to, part);
  }
  const LevelPlanes from = level_planes(textures, step.from_level);
  if (const auto* up = std::get_if<UpInputs>(&step.inputs)) {
    return bloom_up(from, to, up->constants.fine_weight, part);
  }
  if (const auto* blur = std::get_if<GaussianInputs>(&step.inputs)) {
    return gaussian(from, to, blur->constants.vertical != 0, part);
  }
  bloom_down(from, to, part);
}

// A large level is cleared by several threads: one alone cannot use all of the memory's speed.
void clear(const LevelPlanes& level, Crew& crew) {
  constexpr size_t kFloatsOfPart = size_t{1} << 17;
  const size_t row = 3 * level.stride();
  const auto rows = static_cast<uint32_t>(std::max<size_t>(1, kFloatsOfPart / row));
  crew.run(groups(level.height, rows), [&](uint32_t i) {
    const size_t count = std::min(rows, level.height - i * rows);
    std::memset(level.row(size_t{i} * rows, 0), 0, count * row * sizeof(float));
  });
}

}  // namespace

LevelPlanes level_planes(const FrameTextures& textures, size_t level) {
  CHECK(level < textures.layout.level_sizes.size());
  const LevelSize& size = textures.layout.level_sizes[level];
  CHECK(uint64_t{size.width} * size.height * 4 * sizeof(float) <= textures.levels[level].bytes());
  return {reinterpret_cast<float*>(textures.levels[level].buffer().mapped()), size.width, size.height};
}

void run_bloom(const BloomStep& step, const FrameTextures& textures, Crew& crew) {
  const LevelPlanes to = level_planes(textures, step.level);
  if (step.clear_first) clear(to, crew);
  const std::vector<Box> parts = parts_of(step, to, crew.threads());
  crew.run(static_cast<uint32_t>(parts.size()), [&](uint32_t i) { make_part(step, textures, to, parts[i]); });
}

}  // namespace candela::host
#endif
