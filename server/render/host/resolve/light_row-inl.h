// The bloom of the frame's rows, from level 0.
#if defined(CANDELA_HOST_LIGHT_ROW_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_LIGHT_ROW_INL_H
#undef CANDELA_HOST_LIGHT_ROW_INL_H
#else
#define CANDELA_HOST_LIGHT_ROW_INL_H
#endif

#include <hwy/aligned_allocator.h>
#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "server/render/host/resolve/chunk-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

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

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
