// Usage errors: mistakes in the command line itself. They have an exit code of their own.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"

namespace candela {

// An INVALID_ARGUMENT of the kind kUsage, for a wrong use of the command. One line.
absl::Status usage_error(const std::string& message);
bool is_usage_error(const absl::Status& status);

// `--json is empty; leave it out or give it a value`. `option` is "--json".
absl::Status empty_value(const std::string& option);

// `unknown curve "aces-hil"; did you mean aces-hill? There are: linear, aces-hill`. `what` is "curve".
absl::Status unknown_word(const std::string& what, const std::string& typed,
                          const std::vector<std::string>& words);

}  // namespace candela
