// A check for fuzz targets.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <string>

namespace candela {

// If the condition is false, prints `claim` and ends the process, so that the fuzzer keeps the input.
inline void expect(bool holds, const char* claim, const std::string& details = "") {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s %s\n", claim, details.c_str());
  std::abort();
}

}  // namespace candela
