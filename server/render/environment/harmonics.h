// Spherical harmonics of a panorama (docs/environments.md section 3): the host's part, in double.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace candela {

// Nine coefficients of R, G and B, in the order of (l, m): (0,0) (1,-1) (1,0) (1,1) (2,-2) .. (2,2).
using Harmonics = std::array<std::array<double, 3>, 9>;

// The constant factors of the nine polynomials in a direction's x, y and z.
extern const std::array<double, 9> kHarmonicFactors;

// The integrals of sin lon, cos lon, sin 2 lon and cos 2 lon over each column.
std::vector<std::array<float, 4>> column_factors(uint32_t width);

// L_lm of the partial sums that panorama_sh made: SH_PARTS times 16 floats for each row.
Harmonics radiance_of(std::span<const float> sums, uint32_t width, uint32_t height);

// The same for the environment turned by `rotation_deg` about +Y.
Harmonics turned(const Harmonics& radiance, double rotation_deg);

// A_l L_lm.
Harmonics irradiance_of(const Harmonics& radiance);

}  // namespace candela
