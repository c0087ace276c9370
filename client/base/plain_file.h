// Reads small files that options name: certificates, tokens, exposures.
#pragma once

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"

namespace candela {

// The whole text. Never waits for a pipe. NOT_FOUND, without the path, if it cannot be read or is no regular
// file; INVALID_ARGUMENT if it has more than `max_bytes`.
absl::StatusOr<std::string> read_plain_file(const std::string& path, size_t max_bytes);

}  // namespace candela
