// A server's refusals in the words of the command line.
#pragma once

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"

namespace candela {

// A refusal names fields of the contract: "exposure.metering.spot begins at x 900 ...". Returns it with the
// options in their place: "--spot begins at x 900 ...". If it begins with a field, the option's value is
// wrong and the result is a usage error. `given` holds the settings that the user gave. Other errors, and
// names that no option sets, stay as they are, and get their kind from of_server().
absl::Status in_options(const absl::Status& refusal, const v1::Settings& given);

// Gives what a call or a session ended with its kind (client/base/failure.h), unless it has one: kInput if
// the server refuses what it was sent (INVALID_ARGUMENT) or could never hold it (RESOURCE_EXHAUSTED), else
// kServer.
absl::Status of_server(const absl::Status& status);

}  // namespace candela
