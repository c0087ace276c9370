#include "client/image/color.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/image/power.h"

namespace candela {
namespace {

constexpr NamedPrimaries kNamed[] = {
    kRec709,
    {"Rec.2020", "Rec.2020", {0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.3290f}, 9},
    {"P3-D65", "P3-D65 (Display P3)", {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.3127f, 0.3290f}, 12},
    {"P3-DCI", "P3-DCI", {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.314f, 0.351f}, 11, "p3-dci"},
    {"AP0", "ACES2065-1 (AP0)", {0.7347f, 0.2653f, 0, 1, 0.0001f, -0.077f, 0.32168f, 0.33767f}},
    {"AP1", "ACEScg (AP1)", {0.713f, 0.293f, 0.165f, 0.830f, 0.128f, 0.044f, 0.32168f, 0.33767f}},
    kAdobeRgb,
    {"BT.601-625",
     "BT.601, 625 lines",
     {0.64f, 0.33f, 0.29f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f},
     5,
     "bt601-625"},
    {"BT.601-525",
     "BT.601, 525 lines",
     {0.63f, 0.34f, 0.31f, 0.595f, 0.155f, 0.07f, 0.3127f, 0.3290f},
     6,
     "bt601-525"},
    {"BT.470 M", "NTSC (BT.470 M)", {0.67f, 0.33f, 0.21f, 0.71f, 0.14f, 0.08f, 0.310f, 0.316f}, 4, "bt470m"},
    {"film",
     "generic film (illuminant C)",
     {0.681f, 0.319f, 0.243f, 0.692f, 0.145f, 0.049f, 0.310f, 0.316f},
     8,
     "film"},
    {"EBU 3213", "EBU 3213", {0.63f, 0.34f, 0.295f, 0.605f, 0.155f, 0.077f, 0.3127f, 0.3290f}, 22, "ebu3213"},
    kXyz,
};

}  // namespace

std::span<const NamedPrimaries> named_primaries() { return kNamed; }

const NamedPrimaries* find_primaries(const std::array<float, 8>& xy) {
  const auto near = [](float a, float b) { return std::fabs(a - b) <= 5e-4f; };
  const auto* const found = std::ranges::find_if(kNamed, [&](const NamedPrimaries& known) {
    return std::equal(xy.begin(), xy.end(), known.xy.begin(), near);
  });
  return found == std::end(kNamed) ? nullptr : found;
}

std::string xy_words(const std::array<float, 8>& xy) {
  return absl::StrFormat("red %.5g %.5g, green %.5g %.5g, blue %.5g %.5g, white %.5g %.5g", xy[0], xy[1],
                         xy[2], xy[3], xy[4], xy[5], xy[6], xy[7]);
}

namespace {

// The linear spaces first: linear_interop_id() takes the first with its primaries.
constexpr InteropSpace kSpaces[] = {
    {"lin_rec709_scene", "Rec.709", ColorCurve::kLinear},
    {"lin_ap1_scene", "AP1", ColorCurve::kLinear},
    {"lin_ap0_scene", "AP0", ColorCurve::kLinear},
    {"lin_p3d65_scene", "P3-D65", ColorCurve::kLinear},
    {"lin_rec2020_scene", "Rec.2020", ColorCurve::kLinear},
    {"lin_adobergb_scene", "Adobe RGB", ColorCurve::kLinear},
    {"lin_ciexyzd65_scene", "XYZ", ColorCurve::kLinear},
    {"srgb_rec709_scene", "Rec.709", ColorCurve::kSrgb},
    {"srgb_ap1_scene", "AP1", ColorCurve::kSrgb},
    {"srgb_p3d65_scene", "P3-D65", ColorCurve::kSrgb},
    {"g18_rec709_scene", "Rec.709", ColorCurve::kGamma18},
    {"g22_rec709_scene", "Rec.709", ColorCurve::kGamma22},
    {"g22_ap1_scene", "AP1", ColorCurve::kGamma22},
    {"g22_adobergb_scene", "Adobe RGB", ColorCurve::kGamma22},
    {"g24_rec709_scene", "Rec.709", ColorCurve::kGamma24},
};

double gamma_of(ColorCurve curve) {
  return curve == ColorCurve::kGamma18 ? 1.8 : curve == ColorCurve::kGamma22 ? 2.2 : 2.4;
}

}  // namespace

double to_linear(ColorCurve curve, double v) {
  if (curve == ColorCurve::kLinear) return v;
  if (curve == ColorCurve::kSrgb) return v <= 0.04045 ? v / 12.92 : power((v + 0.055) / 1.055, 2.4);
  return std::copysign(power(std::abs(v), gamma_of(curve)), v);
}

const InteropSpace* find_interop_space(absl::string_view id) {
  for (const InteropSpace& space : kSpaces) {
    if (absl::EqualsIgnoreCase(id, space.id)) return &space;
  }
  return nullptr;
}

bool is_display_interop_id(absl::string_view id) {
  if (absl::StrContains(id, ':')) return false;
  return absl::EndsWithIgnoreCase(id, "_display") || absl::StartsWithIgnoreCase(id, "pq_") ||
         absl::StartsWithIgnoreCase(id, "hlg_");
}

std::string linear_interop_id(const std::optional<std::array<float, 8>>& xy) {
  const NamedPrimaries* known = find_primaries(xy.value_or(kRec709.xy));
  for (const InteropSpace& space : kSpaces) {
    if (known != nullptr && absl::string_view(known->name) == space.primaries) return space.id;
  }
  return "unknown";
}

const char* name(ColorCurve curve) {
  switch (curve) {
    case ColorCurve::kLinear:
      return "linear";
    case ColorCurve::kSrgb:
      return "sRGB";
    case ColorCurve::kGamma18:
      return "gamma 1.8";
    case ColorCurve::kGamma22:
      return "gamma 2.2";
    case ColorCurve::kGamma24:
      return "gamma 2.4";
  }
  return "?";
}

void decode(ColorCurve curve, Image& image) {
  if (curve == ColorCurve::kLinear) return;
  std::byte* const end = image.pixels.data() + image.bytes();
  for (std::byte* at = image.pixels.data(); at != end; at += 4 * sizeof(float)) {
    std::array<float, 4> pixel;
    std::memcpy(pixel.data(), at, sizeof pixel);
    const double alpha = pixel[3] > 0 && std::isfinite(pixel[3]) ? pixel[3] : 1.0;
    for (size_t c = 0; c < 3; ++c) {
      pixel[c] = static_cast<float>(alpha * to_linear(curve, pixel[c] / alpha));
    }
    std::memcpy(at, pixel.data(), sizeof pixel);
  }
}

}  // namespace candela
