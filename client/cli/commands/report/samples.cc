#include "client/cli/commands/report/samples.h"

#include <algorithm>
#include <cmath>

#include "client/run/report.h"

namespace candela {

double ms_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const auto below = static_cast<size_t>(at);
  return std::lerp(values[below], values[std::min(below + 1, values.size() - 1)], at - std::floor(at));
}

Json spread(const std::vector<double>& values) {
  return {{"p10", quantile(values, 0.1)}, {"median", quantile(values, 0.5)}, {"p90", quantile(values, 0.9)}};
}

void StageTimes::add(const Stages& stages) {
  for (const v1::StageTime& stage : stages) {
    if (!is_device_stage(stage)) continue;
    auto known = std::find_if(stages_.begin(), stages_.end(),
                              [&stage](const auto& s) { return s.first == stage.name(); });
    if (known == stages_.end()) known = stages_.insert(known, {stage.name(), {}});
    known->second.push_back(ms_of(stage));
  }
}

Json StageTimes::json() const {
  Json rows = Json::array();
  for (const auto& [name, ms] : stages_) rows.push_back({{"name", name}, {"ms", spread(ms)}});
  return rows;
}

}  // namespace candela
