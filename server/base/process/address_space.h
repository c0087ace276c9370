// The address space that ulimit -v leaves to this process.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"

namespace candela {

// The addresses that a server needs. The threads of the driver and of gRPC reserve far more than they use.
uint64_t server_bytes();

// The addresses that a session with a running server needs.
uint64_t session_bytes();

// RESOURCE_EXHAUSTED if ulimit -v allows this process less than `bytes`. `what` needs them: "the built-in
// server". Without this check libraries would end the process when they find no memory.
absl::Status check_address_space(uint64_t bytes, const std::string& what, const std::string& way_out);

}  // namespace candela
