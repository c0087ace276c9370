// Files that options name.
#pragma once

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace candela {

enum class Secrecy { kPublic, kSecret };

// The whole text of the file at `path`, which the option `option` names, as every message does. NOT_FOUND
// where it cannot be read or is no file, INVALID_ARGUMENT for one of more than `max_bytes`.
// FAILED_PRECONDITION for a secret that every user may read, or that others than its owner may change; its
// group may read it, for that is how Kubernetes and systemd hand out secrets.
absl::StatusOr<std::string> read_option_file(absl::string_view option, const std::string& path,
                                             size_t max_bytes, Secrecy secrecy);

}  // namespace candela
