// The file descriptors of this process.
#pragma once

#include <cstdint>

#include "absl/status/status.h"

namespace candela {

// Raises the soft limit to the hard limit. Affects the whole process; programs with select() need the low
// one.
void raise_descriptor_limit();

// FAILED_PRECONDITION, with what to do, if the soft limit is too low to start.
absl::Status check_descriptor_limit();

// The soft limit.
uint64_t descriptor_limit();

// The number that is open now.
uint64_t open_descriptors();

// The numbers that may be open at once. The rest, three eighths of what is left, is for files, the device and
// gRPC itself.
struct DescriptorBudget {
  uint64_t limit = 0;
  uint32_t connections = 0;        // of clients; at least 1
  uint32_t probe_connections = 0;  // to the metrics port; at least 1
};

// Divides what is left. `asked` is the number of connections that the operator wants; 0: 4096.
DescriptorBudget choose_descriptors(uint32_t asked, uint64_t limit = descriptor_limit(),
                                    uint64_t open = open_descriptors());

}  // namespace candela
