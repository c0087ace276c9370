#include "server/render/settings/tiers.h"

namespace candela {

namespace {

constexpr Tier kTiers[] = {
    {"draft",
     "bloom starts at a quarter of the frame's size, sRGB within 0.09 code, aces-1 by 33^3 points "
     "(wide-gamut frames: 49^3); the rest as standard",
     4, 6, 33, 49, false, 0.1},
    {"standard",
     "all of the pipeline in float32, sRGB within 0.0001 code: within 0.01 code of the float64 reference; "
     "aces-1 by 65^3 points (wide-gamut frames: 97^3)",
     2, 8, 65, 97, false, 0.01},
    {"reference",
     "the float64 reference itself, on the host, from a scene that is not rounded to halves; slow", 2, 8, 0,
     0, true, 0.0},
};

}  // namespace

std::span<const Tier> tiers() { return kTiers; }

const Tier* find_tier(const std::string& name) {
  for (const Tier& tier : kTiers) {
    if (name == tier.name) return &tier;
  }
  return nullptr;
}

}  // namespace candela
