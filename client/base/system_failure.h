// Errors for memory and threads that this process could not get.
#pragma once

#include <exception>

#include "absl/status/status.h"

namespace candela {

// RESOURCE_EXHAUSTED, with what the user can do, if it is about memory or a thread.
// INTERNAL with the exception's words for any other.
absl::Status system_failure(const std::exception& error);

}  // namespace candela
