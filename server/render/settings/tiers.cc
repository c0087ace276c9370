#include "server/render/settings/tiers.h"

namespace candela {

namespace {

constexpr Tier kTiers[] = {
    {.name = "draft",
     .summary = "bloom starts at a quarter of the frame's size, sRGB within 0.09 code, aces-1 by 33^3 points "
                "(wide-gamut frames: 49^3); the rest as standard",
     .bloom_level_size = 4,
     .transfer_terms = 6,
     .transfer_codes = 0.084,
     .table_size = 33,
     .wide_table_size = 49,
     .table_codes = {9, 20, 3.3},
     .wide_table_codes = {12, 22, 13},
     .host_reference = false,
     .cube_samples = 4,
     .specular_detail = 0.55},
    {.name = "standard",
     .summary = "all of the pipeline in float32, sRGB within 0.00015 code; aces-1 by 65^3 points (wide-gamut "
                "frames: 97^3)",
     .bloom_level_size = 2,
     .transfer_terms = 8,
     .transfer_codes = 0.00015,
     .table_size = 65,
     .wide_table_size = 97,
     .table_codes = {1.9, 9, 2.2},
     .wide_table_codes = {6, 12, 13},
     .host_reference = false,
     .cube_samples = 4,
     .specular_detail = 0.3},
    {.name = "reference",
     .summary = "the float64 reference itself, on the host, from a scene that is not rounded to halves; slow",
     .bloom_level_size = 2,
     .transfer_terms = 8,
     .transfer_codes = 0,
     .table_size = 0,
     .wide_table_size = 0,
     .table_codes = {},
     .wide_table_codes = {},
     .host_reference = true,
     .cube_samples = 16,
     .specular_detail = 0.1},
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
