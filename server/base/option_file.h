// Reads files that options name.
#pragma once

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace candela {

enum class Secrecy { kPublic, kSecret };

// The whole text of the file at `path`. Errors name the option `option` and the file:
// - NOT_FOUND if it cannot be read or is not a regular file.
// - INVALID_ARGUMENT if it has more than `max_bytes`.
// - FAILED_PRECONDITION for a secret that every user may read, or that anyone but its owner may change. Its
// group may
//   read it, because Kubernetes and systemd hand out secrets that way.
absl::StatusOr<std::string> read_option_file(absl::string_view option, const std::string& path,
                                             size_t max_bytes, Secrecy secrecy);

}  // namespace candela
