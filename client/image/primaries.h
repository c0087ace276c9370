// The primaries that have names.
#pragma once

#include <array>
#include <span>
#include <string>

namespace candela {

struct NamedPrimaries {
  const char* name;         // short, such as "AP1"
  const char* known_as;     // as people know the colour space, such as "ACEScg (AP1)"
  std::array<float, 8> xy;  // CIE 1931 xy of red, green, blue and white
};

inline constexpr NamedPrimaries kRec709{
    "Rec.709", "Rec.709", {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f}};
// The values of red, green and blue are X, Y and Z.
inline constexpr NamedPrimaries kXyz{"XYZ", "CIE XYZ", {1, 0, 0, 1, 0, 0, 1 / 3.0f, 1 / 3.0f}};

// All of them, Rec.709 first.
std::span<const NamedPrimaries> named_primaries();

// The primaries whose numbers are all within 0.0005 of `xy`; null if there are none.
const NamedPrimaries* find_primaries(const std::array<float, 8>& xy);

// "red 0.73 0.27, green 0.17 0.8, blue 0.1 0, white 0.3127 0.329"
std::string xy_words(const std::array<float, 8>& xy);

}  // namespace candela
