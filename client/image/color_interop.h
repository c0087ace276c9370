// The colour spaces that a file names by its colorInteropID. Source: the Color Interop Forum of the Academy
// Software Foundation, "Color Space Encodings for Texture Assets and CG Rendering" and "An ID for Color
// Interop".
#pragma once

#include <array>
#include <optional>
#include <string>

#include "absl/strings/string_view.h"
#include "client/image/image.h"

namespace candela {

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

}  // namespace candela
