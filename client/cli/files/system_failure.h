// What the system did not give this process.
#pragma once

#include <exception>

#include "absl/status/status.h"

namespace candela {

// RESOURCE_EXHAUSTED, with what the user can do, for memory or a thread that the system did not give.
// INTERNAL with the exception's words for any other.
absl::Status system_failure(const std::exception& error);

}  // namespace candela
