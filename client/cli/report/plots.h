// The plots of a report's page.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "client/cli/report/session.h"

namespace candela {

// Each takes the rows of measure_times and gives an <svg> element, or "" where no row has what is to be
// drawn. Fails as plot_svg does.

// Errors below this, 0 among them, have no place on a log scale and are drawn here.
inline constexpr double kErrorFloorCodes = 1e-6;

// Device time against the largest error, log-log: a point a tier and size, and each size's Pareto front.
absl::StatusOr<std::string> plot_time_against_error(const Json& times);

// Each tier's stages at the largest size that all of the tiers were timed at, as bars; without tiers that
// take kBeyondScale times as long as the fastest, beside which the others' stages could not be seen.
inline constexpr double kBeyondScale = 8;
absl::StatusOr<std::string> plot_stages(const Json& times);

// Device time a megapixel against size.
absl::StatusOr<std::string> plot_scaling(const Json& times);

// Which of the points (ms, codes) no other one beats in both: indices, by rising ms.
std::vector<size_t> pareto_front(const std::vector<std::pair<double, double>>& points);

}  // namespace candela
