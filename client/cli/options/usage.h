// Errors of the command line itself, as against those of the work: they end the command with another code.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"

namespace candela {

// An INVALID_ARGUMENT that says the command was used wrongly. One line.
absl::Status usage_error(const std::string& message);
bool is_usage_error(const absl::Status& status);

// The word that `typed` was most likely meant to be, or "" when none is near: at most a third of its letters
// mistyped, left out, too many or swapped with the next one, or the beginning of a single word.
std::string nearest(const std::string& typed, const std::vector<std::string>& words);

// `unknown curve "aces-hil"; did you mean aces-hill? There are: linear, aces-hill`. `what` is "curve".
absl::Status unknown_word(const std::string& what, const std::string& typed,
                          const std::vector<std::string>& words);

}  // namespace candela
