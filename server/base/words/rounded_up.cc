#include "server/base/words/rounded_up.h"

#include <cmath>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"

namespace candela {
namespace {

double value_of(const std::string& text) {
  double value = 0;
  (void)absl::SimpleAtod(text, &value);
  return value;
}

}  // namespace

std::string rounded_up(double bound) {
  if (bound == 0) return "0";
  const double digit = std::pow(10.0, std::floor(std::log10(bound)) - 2);
  const std::string nearest = absl::StrFormat("%.3g", bound);
  return value_of(nearest) >= bound ? nearest : absl::StrFormat("%.3g", value_of(nearest) + digit);
}

}  // namespace candela
