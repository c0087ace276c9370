// What a fuzz target claims of any input.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <string>

namespace candela {

// Ends the process, so that the fuzzer keeps the input: `claim` names what does not hold.
inline void expect(bool holds, const char* claim, const std::string& details = "") {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s %s\n", claim, details.c_str());
  std::abort();
}

}  // namespace candela
