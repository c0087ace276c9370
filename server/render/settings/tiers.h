// Tiers: trade-offs between accuracy and speed, as rows of numbers. No code tests for a tier's name.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace candela {

// The largest error of the tables of aces-1 or aces-2, in codes of the output, by the output's transfer.
// Found by a search for the worst colour (tests/unit/render/error_bound_test.cc repeats it) and a fifth
// larger than what it found.
struct TableError {
  double srgb;
  double gamma22;
  double linear;
};

// Texels of the frame to one texel of the first bloom level, along a side, if no level is left out.
inline constexpr uint32_t kWholeBloom = 2;

struct Tier {
  const char* name;
  const char* summary;  // the trade-off in words, for people
  // Frame texels per texel of the first bloom level, along a side: 2 or 4. With 4 the finest level is left
  // out.
  uint32_t bloom_level_size;
  // Terms of the sRGB transfer's polynomial, and its largest error in codes.
  uint32_t transfer_terms;
  double transfer_codes;
  // Points a side of the aces-1 table, and of the one for frames with light outside of Rec.709; unused with
  // host_reference.
  uint32_t table_size;
  uint32_t wide_table_size;
  TableError table_codes;
  TableError wide_table_codes;  // of light inside of ACES AP1; there is no bound outside
  // Bloom and resolve run in the float64 reference on the host, and the scene is not rounded to halves. A
  // large frame takes seconds.
  bool host_reference;
  // Baking of environments (docs/environments.md), on the device in every tier. K for a panorama whose texels
  // are as large as those of level 0, and the largest side of a texel of the chain that a specular level
  // takes whole, by the distance over which the lobe changes there.
  uint32_t cube_samples;
  double specular_detail;
};

// Cheapest first, and each is at least as accurate as the ones before it.
std::span<const Tier> tiers();

// The tier of that name, or null.
const Tier* find_tier(const std::string& name);

}  // namespace candela
