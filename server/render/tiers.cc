#include "server/render/tiers.h"

namespace candela {

namespace {

constexpr Tier kTiers[] = {
    {"standard",
     "13-tap and tent bloom filters on float32 levels, half-float scene, transfer within 0.0001 code; the "
     "whole frame "
     "within 0.01 code of the float64 reference"},
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
