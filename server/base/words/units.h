// Parses and prints sizes and times as people write them in flags and files.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace candela {

// "512MiB", "2GiB", "1048576": bytes, optionally with KiB, MiB, GiB or TiB. Case does not matter.
absl::StatusOr<uint64_t> parse_bytes(const std::string& text);
// Uses the largest suffix without a remainder: "512MiB".
std::string format_bytes(uint64_t bytes);

// "60s", "1m30s", "500ms".
absl::StatusOr<absl::Duration> parse_duration(const std::string& text);

}  // namespace candela
