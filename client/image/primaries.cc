#include "client/image/primaries.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"

namespace candela {
namespace {

constexpr NamedPrimaries kNamed[] = {
    kRec709,
    {"Rec.2020", "Rec.2020", {0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.3290f}},
    {"P3-D65", "P3-D65 (Display P3)", {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.3127f, 0.3290f}},
    {"P3-DCI", "P3-DCI", {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.314f, 0.351f}},
    {"AP0", "ACES2065-1 (AP0)", {0.7347f, 0.2653f, 0, 1, 0.0001f, -0.077f, 0.32168f, 0.33767f}},
    {"AP1", "ACEScg (AP1)", {0.713f, 0.293f, 0.165f, 0.830f, 0.128f, 0.044f, 0.32168f, 0.33767f}},
    {"Adobe RGB", "Adobe RGB (1998)", {0.64f, 0.33f, 0.21f, 0.71f, 0.15f, 0.06f, 0.3127f, 0.3290f}},
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

}  // namespace candela
