// Tiers: how much accuracy is spent. There is one so far.
#pragma once

#include <span>
#include <string>

namespace candela {

struct Tier {
  const char* name;
  const char* summary;  // what it promises and what it costs, for people
};

// Cheapest first.
std::span<const Tier> tiers();

// The tier of that name, or null.
const Tier* find_tier(const std::string& name);

}  // namespace candela
