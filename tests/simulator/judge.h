// What a session may come to.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "absl/status/status.h"
#include "tests/simulator/client.h"

namespace candela::testing {

struct Circumstances {
  const std::map<std::string, uint64_t>& struck;  // the faults that there were, by their names
  bool disturbed = false;                         // there could be any
  bool impatient = false;                         // the session gives up soon

  bool has(const char* fault) const { return struck.contains(fault); }
};

// Why what a client was told is wrong; OK if it is right, or if its session has not ended.
absl::Status judge(const SimulatedClient& client, const Circumstances& circumstances);

}  // namespace candela::testing
