// One history: clients, servers and faults that a seed decides, and the verdict on what came of them.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace candela::testing {

struct HistoryReport {
  absl::Status verdict;   // why it is wrong
  absl::Duration lasted;  // in virtual time
  uint64_t events = 0;
  uint64_t frames = 0;  // that had their result
  uint64_t resumes = 0;
  std::map<std::string, uint64_t> struck;  // how often each fault did
  std::map<std::string, uint64_t> ends;    // of sessions, by their code
};

// `log`: prints every event.
HistoryReport run_history(uint64_t seed, bool log);

// The faults that there are, each with what it does.
std::vector<std::pair<std::string, std::string>> all_faults();

}  // namespace candela::testing
