// The time that each stage of a frame took.
#pragma once

#include <chrono>
#include <cstdint>
#include <vector>

namespace candela {

struct StageTime {
  const char* name;  // a pass's name, see plan.h, or "upload", "download", "reference", "verify"
  uint64_t ns;       // device time; host time for "reference" and "verify"
};

// Adds the time to the stage of the same name, or appends a new stage.
void add_time(const StageTime& time, std::vector<StageTime>* stages);

// Adds to the stage the host time from construction to destruction, without pauses between slices.
class HostStage {
 public:
  // `name` and `stages` outlive it.
  HostStage(const char* name, std::vector<StageTime>* stages);
  HostStage(const HostStage&) = delete;
  HostStage& operator=(const HostStage&) = delete;
  ~HostStage();

 private:
  const char* name_;
  std::vector<StageTime>* stages_;
  const std::chrono::steady_clock::time_point begin_;
  const std::chrono::nanoseconds paused_before_;
};

}  // namespace candela
