#include "client/image/read/exr_zip_kernels.h"

#include <cstring>

// What is left: the baseline, SSE4, AVX2, AVX-512 and NEON.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "client/image/read/exr_zip_kernels.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace candela {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Each kernel is a loop over vectors and one over the rest. The baseline, HWY_SCALAR, has no vectors.

void undo_predictor_here(uint8_t* bytes, size_t count) {
  size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::FixedTag<uint8_t, 16> d;
  const auto bias = hn::Set(d, 128);
  const auto last = hn::Set(d, 15);
  auto before = bias;  // takes back the bias of the first byte, which has none
  for (; i + 16 <= count; i += 16) {
    auto sum = hn::Add(hn::LoadU(d, bytes + i), bias);
    sum = hn::Add(sum, hn::ShiftLeftBytes<1>(sum));
    sum = hn::Add(sum, hn::ShiftLeftBytes<2>(sum));
    sum = hn::Add(sum, hn::ShiftLeftBytes<4>(sum));
    sum = hn::Add(sum, hn::ShiftLeftBytes<8>(sum));
    hn::StoreU(hn::Add(sum, before), d, bytes + i);
    before = hn::Add(before, hn::TableLookupBytes(sum, last));  // the only step that waits for the last turn
  }
#endif
  auto value = static_cast<uint8_t>(i == 0 ? 128 : bytes[i - 1]);
  for (; i < count; ++i) bytes[i] = value = static_cast<uint8_t>(value + bytes[i] + 128);
}

void interleave_bytes_here(const uint8_t* even, const uint8_t* odd, uint8_t* out, size_t count) {
  size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<uint8_t> d;
  for (; 2 * (i + hn::Lanes(d)) <= count; i += hn::Lanes(d)) {
    hn::StoreInterleaved2(hn::LoadU(d, even + i), hn::LoadU(d, odd + i), d, out + 2 * i);
  }
#endif
  for (i *= 2; i < count; ++i) out[i] = i % 2 == 0 ? even[i / 2] : odd[i / 2];
}

template <typename T>
void planes_to_rgba(const RowPlanes& planes, T one, std::byte* rgba, size_t pixels) {
  auto* out = reinterpret_cast<T*>(rgba);
  const auto fill = [&](size_t c) { return c == 3 ? one : T{0}; };
  size_t x = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<T> d;
  const hn::Repartition<uint8_t, decltype(d)> bytes;
  const auto load = [&](size_t c) {
    return planes[c] == nullptr ? hn::Set(d, fill(c))
                                : hn::BitCast(d, hn::LoadU(bytes, planes[c] + x * sizeof(T)));
  };
  for (; x + hn::Lanes(d) <= pixels; x += hn::Lanes(d)) {
    hn::StoreInterleaved4(load(0), load(1), load(2), load(3), d, out + 4 * x);
  }
#endif
  for (; x < pixels; ++x) {
    for (size_t c = 0; c < 4; ++c) {
      T value = fill(c);
      if (planes[c] != nullptr) std::memcpy(&value, planes[c] + x * sizeof(T), sizeof(T));
      out[4 * x + c] = value;
    }
  }
}

void halves_to_rgba_here(const RowPlanes& planes, std::byte* rgba, size_t pixels) {
  planes_to_rgba<uint16_t>(planes, 0x3c00, rgba, pixels);
}

void floats_to_rgba_here(const RowPlanes& planes, std::byte* rgba, size_t pixels) {
  planes_to_rgba<uint32_t>(planes, 0x3f800000, rgba, pixels);
}

}  // namespace HWY_NAMESPACE
}  // namespace candela
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace candela {

HWY_EXPORT(undo_predictor_here);
HWY_EXPORT(interleave_bytes_here);
HWY_EXPORT(halves_to_rgba_here);
HWY_EXPORT(floats_to_rgba_here);

void undo_predictor(std::span<uint8_t> bytes) {
  HWY_DYNAMIC_DISPATCH(undo_predictor_here)(bytes.data(), bytes.size());
}

void interleave_bytes(const uint8_t* even, const uint8_t* odd, std::span<uint8_t> out) {
  HWY_DYNAMIC_DISPATCH(interleave_bytes_here)(even, odd, out.data(), out.size());
}

void halves_to_rgba(const RowPlanes& planes, std::byte* rgba, size_t pixels) {
  HWY_DYNAMIC_DISPATCH(halves_to_rgba_here)(planes, rgba, pixels);
}

void floats_to_rgba(const RowPlanes& planes, std::byte* rgba, size_t pixels) {
  HWY_DYNAMIC_DISPATCH(floats_to_rgba_here)(planes, rgba, pixels);
}

}  // namespace candela
#endif  // HWY_ONCE
