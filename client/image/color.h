// Colour spaces: the primaries that have names, what files name by an ID, and the matrices of luma.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>

#include "absl/strings/string_view.h"
#include "client/image/image.h"

namespace candela {

// The primaries that have names.

struct NamedPrimaries {
  const char* name;         // short, such as "AP1"
  const char* known_as;     // as people know the colour space, such as "ACEScg (AP1)"
  std::array<float, 8> xy;  // CIE 1931 xy of red, green, blue and white
  int code = 0;             // ColourPrimaries of ITU-T H.273; 0 if it does not have them
  const char* word = "";    // of --primaries, if the contract has none
};

inline constexpr NamedPrimaries kRec709{
    "Rec.709", "Rec.709", {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f}, 1};
inline constexpr NamedPrimaries kAdobeRgb{"Adobe RGB",
                                          "Adobe RGB (1998)",
                                          {0.64f, 0.33f, 0.21f, 0.71f, 0.15f, 0.06f, 0.3127f, 0.3290f},
                                          0,
                                          "adobe-rgb"};
// The values of red, green and blue are X, Y and Z.
inline constexpr NamedPrimaries kXyz{"XYZ", "CIE XYZ", {1, 0, 0, 1, 0, 0, 1 / 3.0f, 1 / 3.0f}, 10};

// All of them, Rec.709 first.
std::span<const NamedPrimaries> named_primaries();

// The primaries whose numbers are all within 0.0005 of `xy`; null if there are none.
const NamedPrimaries* find_primaries(const std::array<float, 8>& xy);

// "red 0.73 0.27, green 0.17 0.8, blue 0.1 0, white 0.3127 0.329"
std::string xy_words(const std::array<float, 8>& xy);

// The colour spaces that a file names by its colorInteropID. Source: the Color Interop Forum of the Academy
// Software Foundation, "Color Space Encodings for Texture Assets and CG Rendering" and "An ID for Color
// Interop".

enum class ColorCurve { kLinear, kSrgb, kGamma18, kGamma22, kGamma24 };

// A colour space of scene light.
struct InteropSpace {
  const char* id;         // "srgb_ap1_scene"
  const char* primaries;  // NamedPrimaries::name
  ColorCurve curve;
};

// The space of this ID, in any case; null if it is none of scene light.
const InteropSpace* find_interop_space(absl::string_view id);

// Whether the ID names the signal of a display: one of the Forum's, another one that ends in "_display", or
// PQ or HLG of anything. False for an ID with a namespace, such as "studio:name": only its studio knows what
// it means.
bool is_display_interop_id(absl::string_view id);

// "lin_ap1_scene" for linear light of these primaries, which are Rec.709 if there are none; "unknown" if no
// space has them.
std::string linear_interop_id(const std::optional<std::array<float, 8>>& xy);

const char* name(ColorCurve curve);  // "sRGB", "gamma 2.2"

// Linear light of an encoded value. Below 0 the straight piece of sRGB continues, and a gamma is mirrored.
double to_linear(ColorCurve curve, double value);

// Decodes the image's R, G and B from the curve to linear light. They are associated with alpha, so they are
// divided by it before and multiplied by it after; where alpha is 0 or less, they are decoded as they are.
// `image` is kRgba32f.
void decode(ColorCurve curve, Image& image);

// The matrices of y4m's planes, from R, G and B to luma and two colour differences.

// The shares of R, G and B in luma Y, and what B - Y and R - Y are divided by.
struct LumaMatrix {
  float red, green, blue, cb, cr;
  int code;  // MatrixCoefficients of ITU-T H.273
  const char* name;
};
inline constexpr LumaMatrix kRec709Luma{.2126f, .7152f, .0722f, 1.8556f, 1.5748f, 1, "BT.709"};
inline constexpr LumaMatrix kRec601Luma{.299f, .587f, .114f, 1.772f, 1.402f, 6, "BT.601"};
inline constexpr LumaMatrix kRec2020Luma{.2627f, .6780f, .0593f, 1.8814f, 1.4746f, 9, "BT.2020"};
inline constexpr LumaMatrix kLumaMatrices[] = {kRec709Luma,
                                               kRec601Luma,
                                               kRec2020Luma,
                                               {.30f, .59f, .11f, 1.78f, 1.40f, 4, "FCC"},
                                               {.212f, .701f, .087f, 1.826f, 1.576f, 7, "SMPTE ST 240"}};

// A y4m names no matrix. Of fewer lines it is BT.601's, as ffmpeg and others take it.
inline constexpr uint32_t kHdLines = 720;

}  // namespace candela
