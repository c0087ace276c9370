// Colour primaries, and the matrix from a frame's own to the scene's Rec.709.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"

namespace candela {

// CIE 1931 xy of the red, green and blue primaries and of white.
struct Chromaticities {
  std::array<double, 8> xy{};  // red x, red y, green x, ... white x, white y
};

// The chromaticities of named primaries, from SMPTE ST 2065-1 and S-2014-004 (ACES), ITU-R BT.709 and
// BT.2020, SMPTE EG 432-1 (P3-D65) and CIE 15 (XYZ).
Chromaticities chromaticities(v1::Primaries primaries);
Chromaticities chromaticities(const v1::Chromaticities& message);

// The 3x3 matrix, row by row, that converts linear RGB of these primaries to XYZ, with white at Y = 1. All 0
// if the chromaticities span no volume. Source: SMPTE RP 177-1993.
std::array<double, 9> matrix_to_xyz(const Chromaticities& from);

// The chromaticity of a scene's white.
struct White {
  double x = 0.0;  // CIE 1931
  double y = 0.0;
};

// The white of a correlated colour temperature, 2000 .. 25000 K. `tint` moves it perpendicular to the
// Planckian locus in CIE 1960 uv: 1 is 0.05 above the locus, towards green; -1 is 0.05 below it. Both move
// smoothly.
White white_of(double kelvin, double tint);

// The 3x3 matrix, row by row, that converts linear RGB of these primaries to linear Rec.709 with a D65 white;
// absent if it is within 1e-5 of the identity. A white that is not D65 is adapted by Bradford, except that
// plain CIE XYZ (primaries (1,0) (0,1) (0,0), equal-energy white) is not adapted. INVALID_ARGUMENT if the
// chromaticities are not finite or span no volume. Source: SMPTE RP 177-1993; Bradford: Lam 1985, as in
// ICC.1:2010 annex E.
//
// With a scene white, the scene's light is adapted once more, so that this white becomes D65 (white balance).
absl::StatusOr<std::optional<std::array<float, 9>>> matrix_to_rec709(
    const Chromaticities& from, const std::optional<White>& scene_white = std::nullopt);

// The same for the primaries and the white balance that complete settings ask for.
absl::StatusOr<std::optional<std::array<float, 9>>> scene_matrix(const v1::Settings& settings);

}  // namespace candela
