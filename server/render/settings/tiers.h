// Tiers: trade-offs between accuracy and speed, as rows of numbers. No code tests for a tier's name.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace candela {

struct Tier {
  const char* name;
  const char* summary;  // the trade-off in words, for people
  // Frame texels per texel of the first bloom level, along a side: 2 or 4. With 4 the finest level is left
  // out.
  uint32_t bloom_level_size;
  // Terms of the sRGB transfer's polynomial: 8 are within 0.0001 code of the exact curve, 6 within 0.083.
  uint32_t transfer_terms;
  // Points a side of the aces-1 table, and of the one for frames with light outside of Rec.709; unused with
  // host_reference.
  uint32_t table_size;
  uint32_t wide_table_size;
  // Bloom and resolve run in the float64 reference on the host, and the scene is not rounded to halves. A
  // large frame takes seconds.
  bool host_reference;
  // The largest error in codes that the tests allow on any frame, apart from the errors of bloom and tables.
  double bound_codes;
};

// Cheapest first.
std::span<const Tier> tiers();

// The tier of that name, or null.
const Tier* find_tier(const std::string& name);

}  // namespace candela
