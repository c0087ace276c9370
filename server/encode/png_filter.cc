#include "server/encode/png_filter.h"

// What has none of these runs Highway's plain code.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "server/encode/png_filter.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstring>

HWY_BEFORE_NAMESPACE();
namespace candela::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using Bytes = hn::ScalableTag<uint8_t>;
using Byte = hn::Vec<Bytes>;
constexpr Bytes kBytes;
constexpr hn::RebindToSigned<Bytes> kSigned;
constexpr hn::Repartition<uint64_t, Bytes> kSums;
using Sum = hn::Vec<hn::Repartition<uint64_t, Bytes>>;
static_assert(hn::MaxLanes(kBytes) <= kPngMargin);

enum Filter : uint8_t { kSub = 1, kUp = 2, kAverage = 3, kPaeth = 4 };

HWY_INLINE Byte difference(Byte a, Byte b) { return hn::Max(hn::SaturatedSub(a, b), hn::SaturatedSub(b, a)); }

// The one of left, up and corner that is nearest to left + up - corner; the first of those if several are.
// The distances are a = |up - corner|, b = |left - corner| and c, which is a + b where up and left lie on the
// same side of the corner, else |a - b|. A sum beyond 255 is as far as 255: a or b is less than it.
HWY_INLINE Byte paeth(Byte left, Byte up, Byte corner) {
  const Byte a = difference(up, corner);
  const Byte b = difference(left, corner);
  const auto up_above = hn::Eq(hn::Max(up, corner), up);
  const auto left_above = hn::Eq(hn::Max(left, corner), left);
  const Byte c = hn::IfThenElse(hn::Xor(up_above, left_above), difference(a, b), hn::SaturatedAdd(a, b));
  const Byte least = hn::Min(hn::Min(a, b), c);
  return hn::IfThenElse(hn::Eq(a, least), left, hn::IfThenElse(hn::Eq(b, least), up, corner));
}

template <Filter kFilter>
HWY_INLINE Byte predict(Byte left, Byte up, Byte corner) {
  if constexpr (kFilter == kSub) return left;
  if constexpr (kFilter == kUp) return up;
  // AverageRound rounds up, but PNG rounds down.
  if constexpr (kFilter == kAverage) {
    return hn::Sub(hn::AverageRound(left, up), hn::And(hn::Xor(left, up), hn::Set(kBytes, 1)));
  }
  return paeth(left, up, corner);
}

struct Neighbours {
  Byte here, left, up, corner;
};

HWY_INLINE Neighbours load(const uint8_t* row, const uint8_t* above, size_t pixel_bytes) {
  return {hn::LoadU(kBytes, row), hn::LoadU(kBytes, row - pixel_bytes), hn::LoadU(kBytes, above),
          hn::LoadU(kBytes, above - pixel_bytes)};
}

template <Filter kFilter>
HWY_INLINE Byte filtered(const Neighbours& at) {
  return hn::Sub(at.here, predict<kFilter>(at.left, at.up, at.corner));
}

template <Filter kFilter, typename Mask>
HWY_INLINE void add_magnitudes(const Neighbours& at, Mask inside, Sum& sum) {
  const Byte magnitudes = hn::BitCast(kBytes, hn::Abs(hn::BitCast(kSigned, filtered<kFilter>(at))));
  sum = hn::Add(sum, hn::SumsOf8(hn::IfThenElseZero(inside, magnitudes)));
}

Filter best_filter(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes) {
  Sum sub = hn::Zero(kSums), up = sub, average = sub, paeths = sub;
  for (size_t i = 0; i < bytes; i += hn::Lanes(kBytes)) {
    const Neighbours at = load(row + i, above + i, pixel_bytes);
    const auto inside = hn::FirstN(kBytes, std::min(bytes - i, hn::Lanes(kBytes)));
    add_magnitudes<kSub>(at, inside, sub);
    add_magnitudes<kUp>(at, inside, up);
    add_magnitudes<kAverage>(at, inside, average);
    add_magnitudes<kPaeth>(at, inside, paeths);
  }
  uint64_t sums[4];
  sums[0] = hn::GetLane(hn::SumOfLanes(kSums, sub));
  sums[1] = hn::GetLane(hn::SumOfLanes(kSums, up));
  sums[2] = hn::GetLane(hn::SumOfLanes(kSums, average));
  sums[3] = hn::GetLane(hn::SumOfLanes(kSums, paeths));
  return static_cast<Filter>(kSub + (std::min_element(sums, sums + 4) - sums));
}

template <Filter kFilter>
void write_row(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes, uint8_t* out) {
  out[0] = kFilter;
  for (size_t i = 0; i < bytes; i += hn::Lanes(kBytes)) {
    hn::StoreU(filtered<kFilter>(load(row + i, above + i, pixel_bytes)), kBytes, out + 1 + i);
  }
}

void filter_row(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes, uint8_t* out) {
  switch (best_filter(row, above, bytes, pixel_bytes)) {
    case kSub:
      return write_row<kSub>(row, above, bytes, pixel_bytes, out);
    case kUp:
      return write_row<kUp>(row, above, bytes, pixel_bytes, out);
    case kAverage:
      return write_row<kAverage>(row, above, bytes, pixel_bytes, out);
    case kPaeth:
      return write_row<kPaeth>(row, above, bytes, pixel_bytes, out);
  }
}

template <typename V>
HWY_INLINE V high_byte_first(V v) {
  if constexpr (sizeof(hn::TFromV<V>) == 1) return v;
  if constexpr (sizeof(hn::TFromV<V>) == 2) return hn::Or(hn::ShiftLeft<8>(v), hn::ShiftRight<8>(v));
}

// Returns how many pixels are packed. What is left is less than a vector.
template <typename Component>
uint32_t pack_vectors(const Component* rgba, uint32_t pixels, bool alpha, Component* row) {
  const hn::ScalableTag<Component> d;
  const auto lanes = static_cast<uint32_t>(hn::Lanes(d));
  uint32_t x = 0;
  for (; pixels - x >= lanes; x += lanes) {
    hn::Vec<decltype(d)> r, g, b, a;
    hn::LoadInterleaved4(d, rgba + size_t{4} * x, r, g, b, a);
    r = high_byte_first(r), g = high_byte_first(g), b = high_byte_first(b), a = high_byte_first(a);
    if (alpha) hn::StoreInterleaved4(r, g, b, a, d, row + size_t{4} * x);
    if (!alpha) hn::StoreInterleaved3(r, g, b, d, row + size_t{3} * x);
  }
  return x;
}

void pack_row(const std::byte* rgba, uint32_t pixels, bool wide, bool alpha, uint8_t* row) {
  const size_t kept = alpha ? 4 : 3;
  if (!wide && alpha) {
    std::memcpy(row, rgba, kept * pixels);
  } else if (!wide) {
    const auto* from = reinterpret_cast<const uint8_t*>(rgba);
    for (size_t x = pack_vectors(from, pixels, alpha, row); x < pixels; ++x) {
      std::memcpy(row + kept * x, from + 4 * x, kept);
    }
  } else {
    const auto* from = reinterpret_cast<const uint16_t*>(rgba);
    for (size_t x = pack_vectors(from, pixels, alpha, reinterpret_cast<uint16_t*>(row)); x < pixels; ++x) {
      for (size_t c = 0; c < kept; ++c) {
        row[2 * (kept * x + c)] = static_cast<uint8_t>(from[4 * x + c] >> 8);
        row[2 * (kept * x + c) + 1] = static_cast<uint8_t>(from[4 * x + c]);
      }
    }
  }
}

}  // namespace

void filter_row_here(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes,
                     uint8_t* out) {
  filter_row(row, above, bytes, pixel_bytes, out);
}

void pack_row_here(const std::byte* rgba, uint32_t pixels, bool wide, bool alpha, uint8_t* row) {
  pack_row(rgba, pixels, wide, alpha, row);
}

}  // namespace candela::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace candela {

HWY_EXPORT(filter_row_here);
HWY_EXPORT(pack_row_here);

void filter_png_row(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes,
                    uint8_t* out) {
  HWY_DYNAMIC_DISPATCH(filter_row_here)(row, above, bytes, pixel_bytes, out);
}

void pack_png_row(const std::byte* rgba, uint32_t pixels, bool wide, bool alpha, uint8_t* row) {
  HWY_DYNAMIC_DISPATCH(pack_row_here)(rgba, pixels, wide, alpha, row);
}

}  // namespace candela
#endif
