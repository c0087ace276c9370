#include "client/cli/commands/render/held_exposure.h"

#include "absl/strings/str_format.h"
#include "client/base/number_words.h"
#include "proto/candela/v1/settings.h"

namespace candela {

std::string held_words(double target, double target_before_limits) {
  if (target_before_limits == 0 || target == target_before_limits) return "";
  const bool above = target < target_before_limits;
  return absl::StrFormat("exposure held at %s %s; it would have been %s%s",
                         above ? "--max-exposure" : "--min-exposure", v1::format_number(target),
                         in_digits(target_before_limits, 4),
                         above ? "; --ignore-below 0.01 leaves a black background out of the metering" : "");
}

}  // namespace candela
