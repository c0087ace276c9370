// Tiers: how much accuracy is spent, as rows of numbers. No code asks for a tier by its name.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace candela {

struct Tier {
  const char* name;
  const char* summary;  // what it trades, for people
  // Texels of the frame to one of the first bloom level, along a side: 2, or 4, which leaves the finest level
  // out.
  uint32_t bloom_level_size;
  // Terms of the sRGB transfer's polynomial: 8 are within 0.0001 code of the exact curve, 6 within 0.083.
  uint32_t transfer_terms;
  uint32_t table_size;  // points a side of the table of aces-1; unused with host_reference
  // Bloom and resolve run in the float64 reference on the host, from a scene that is not rounded to halves:
  // seconds for a large frame.
  bool host_reference;
  // Codes: the tests hold what the tier gives up on no frame to this, bloom's and tables' own error apart.
  double bound_codes;
};

// Cheapest first.
std::span<const Tier> tiers();

// The tier of that name, or null.
const Tier* find_tier(const std::string& name);

}  // namespace candela
