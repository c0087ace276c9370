// The sRGB transfer (docs/pipeline.md section 5) without square roots, for each target of Highway.
//
// transfer.glsl takes two square roots of each component, and a core needs many cycles for a vector of them.
// Here x = 2^e m with 1 <= m < 2, so x^(1/2.4) is the product of 2^(e/2.4), from a table in registers, and a
// polynomial for m^(1/2.4).
#if defined(CANDELA_HOST_SRGB_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_SRGB_INL_H
#undef CANDELA_HOST_SRGB_INL_H
#else
#define CANDELA_HOST_SRGB_INL_H
#endif

#include <hwy/highway.h>

#include <array>

#include "server/render/host/lanes/glsl-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

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

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
