#include "server/render/plan/frame_stats.h"

#include <algorithm>
#include <cstring>

#include "server/base/slices.h"

namespace candela {

void add_time(const StageTime& time, std::vector<StageTime>* stages) {
  const auto same = std::find_if(stages->begin(), stages->end(), [&](const StageTime& stage) {
    return std::strcmp(stage.name, time.name) == 0;
  });
  if (same == stages->end()) {
    stages->push_back(time);
  } else {
    same->ns += time.ns;
  }
}

HostStage::HostStage(const char* name, std::vector<StageTime>* stages)
    : name_(name), stages_(stages), begin_(std::chrono::steady_clock::now()), paused_before_(time_paused()) {}

HostStage::~HostStage() {
  const std::chrono::nanoseconds took =
      std::chrono::steady_clock::now() - begin_ - (time_paused() - paused_before_);
  add_time({name_, static_cast<uint64_t>(took.count())}, stages_);
}

}  // namespace candela
