// Bloom, from level to level (shaders/bloom/bloom_down.comp, bloom_up.comp, gaussian.comp), for each target
// of Highway.
//
// Every pass filters columns first, from the rows of a level into a strip of floats, and then that strip
// along the row. Strips are a few hundred columns, so that they and the rows that they come from stay in the
// first cache while the pass walks down.
#include "server/render/host/lanes/targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/render/host/bloom/bloom_levels.cc"
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

}  // namespace candela::host
#endif
