#include "client/image/color_interop.h"

#include <cmath>
#include <cstring>

#include "absl/strings/match.h"
#include "client/image/power.h"
#include "client/image/primaries.h"

namespace candela {
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
