// The times of several frames or bakes, and their spread.
#pragma once

#include <chrono>
#include <string>
#include <utility>
#include <vector>

#include "client/cli/commands/report/session.h"

namespace candela {

double ms_since(std::chrono::steady_clock::time_point begin);

// Interpolates linearly between neighbouring values; `values` is not empty.
double quantile(std::vector<double> values, double q);

// {p10, median, p90} of docs/report/format.md.
Json spread(const std::vector<double>& values);

// The times of each device stage over several runs.
class StageTimes {
 public:
  void add(const Stages& stages);

  // Rows of `name` and `ms`, in execution order.
  Json json() const;

 private:
  std::vector<std::pair<std::string, std::vector<double>>> stages_;
};

}  // namespace candela
