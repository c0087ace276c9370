// The last stages of resolve: finished pixels in the output's format.
#if defined(CANDELA_HOST_WRITE_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_WRITE_INL_H
#undef CANDELA_HOST_WRITE_INL_H
#else
#define CANDELA_HOST_WRITE_INL_H
#endif

#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <cstring>

#include "server/render/host/resolve/look-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

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

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
