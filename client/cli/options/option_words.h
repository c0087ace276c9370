// A server's refusals in the words of the command line.
#pragma once

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"

namespace candela {

// A refusal names fields of the contract: "exposure.metering.spot begins at x 900 ...". Returns it with the
// options in their place: "--spot begins at x 900 ...". If it begins with a field, the option's value is
// wrong and the result is a usage error. `given` holds the settings that the user gave. Other errors, and
// names that no option sets, stay as they are.
absl::Status in_options(const absl::Status& refusal, const v1::Settings& given);

}  // namespace candela
