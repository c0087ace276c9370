#include "proto/candela/v1/rounded_up.h"

#include <cmath>

#include "absl/strings/str_format.h"

namespace candela::v1 {

std::string rounded_up(double bound) {
  if (bound == 0) return "0";
  const double digit = std::pow(10.0, std::floor(std::log10(bound)) - 2);
  const std::string nearest = absl::StrFormat("%.3g", bound);
  return std::stod(nearest) >= bound ? nearest : absl::StrFormat("%.3g", std::stod(nearest) + digit);
}

}  // namespace candela::v1
