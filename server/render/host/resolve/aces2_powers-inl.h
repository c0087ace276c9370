// The powers of ACES 2.0 (docs/pipeline.md section 5) without logarithms, for each target of Highway: x = 2^e
// m with 1 <= m < 2, so a power of x is the product of that of 2^e, from two tables in registers, and a
// polynomial for that of m. The errors are of the polynomials, whose values are 1 to 5.2.
#if defined(CANDELA_HOST_ACES2_POWERS_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef CANDELA_HOST_ACES2_POWERS_INL_H
#undef CANDELA_HOST_ACES2_POWERS_INL_H
#else
#define CANDELA_HOST_ACES2_POWERS_INL_H
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <array>
#include <limits>

#include "server/render/host/lanes/glsl-inl.h"

HWY_BEFORE_NAMESPACE();
namespace candela::host::HWY_NAMESPACE {

using glsl::F;
using glsl::U;

// Powers of 2^k and of 2^(16 k - 127), 0 <= k < 16.
struct PowersOfTwo {
  alignas(64) std::array<float, 16> low{};
  alignas(64) std::array<float, 16> high{};

  constexpr explicit PowersOfTwo(double power_of_2) {
    double power = 1;
    for (float& one : low) {
      one = static_cast<float>(power);
      power *= power_of_2;
    }
    const double step = power;
    power = 1;
    for (int i = 0; i < 127; ++i) power /= power_of_2;
    for (float& one : high) {
      one = static_cast<float>(std::min<double>(power, std::numeric_limits<float>::max()));
      power *= step;
    }
  }
};

HWY_INLINE F power_of_two(const PowersOfTwo& powers, F x) {
  const U exponent = glsl::floatBitsToUint(x) >> 23;
  return F(look_up(powers.low, exponent.v)) * F(look_up(powers.high, (exponent >> 4).v));
}
HWY_INLINE F mantissa(F x) {
  return glsl::uintBitsToFloat((glsl::floatBitsToUint(x) & U(0x007fffffu)) | U(0x3f800000u));
}

// m^0.42.
// fit: m in [1, 2], degree 6, error 2.1e-07, best 1.9e-07
HWY_INLINE F cone_mantissa(F m) {
  F q = m * -0.00279401592 + 0.0303788036;
  q = q * m - 0.1431503;
  q = q * m + 0.386431813;
  q = q * m - 0.683716714;
  q = q * m + 1.06558919;
  q = q * m + 0.347261429;
  return q;
}
// m^(1/0.42).
// fit: m in [1, 2], degree 5, error 5.6e-07, best 5.5e-07
HWY_INLINE F cone_root_mantissa(F m) {
  F q = m * 0.00381008652 - 0.0457441919;
  q = q * m + 0.351129234;
  q = q * m + 0.827502012;
  q = q * m - 0.163555652;
  q = q * m + 0.0268590692;
  return q;
}
// m^1.13705602.
// fit: m in [1, 2], degree 5, error 3.0e-07, best 3.0e-07
HWY_INLINE F lightness_mantissa(F m) {
  F q = m * -0.00138433697 + 0.0138674658;
  q = q * m - 0.0625672042;
  q = q * m + 0.195957631;
  q = q * m + 0.884317696;
  q = q * m - 0.03019155;
  return q;
}
// m^(1/1.13705602).
// fit: m in [1, 2], degree 5, error 3.2e-07, best 3.2e-07
HWY_INLINE F achromatic_mantissa(F m) {
  F q = m * 0.0013843741 - 0.0135723921;
  q = q * m + 0.0586417578;
  q = q * m - 0.161011502;
  q = q * m + 1.07290435;
  q = q * m + 0.0416537337;
  return q;
}

// The functions of shaders/glsl/aces2_powers.glsl, for x >= 0.
struct Aces2Powers {
  static HWY_INLINE F cone_power(F x) {
    static constexpr PowersOfTwo kPowers(1.337927554786112);
    return power_of_two(kPowers, x) * cone_mantissa(mantissa(x));
  }
  static HWY_INLINE F cone_root(F x) {
    static constexpr PowersOfTwo kPowers(5.208804828372927);
    return power_of_two(kPowers, x) * cone_root_mantissa(mantissa(x));
  }
  static HWY_INLINE F lightness_of(F x) {
    static constexpr PowersOfTwo kPowers(2.1993176987586445);
    return power_of_two(kPowers, x) * lightness_mantissa(mantissa(x));
  }
  static HWY_INLINE F achromatic_of(F x) {
    static constexpr PowersOfTwo kPowers(1.8396918624132315);
    return power_of_two(kPowers, x) * achromatic_mantissa(mantissa(x));
  }
};

}  // namespace candela::host::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
