// Bytes to standard output, which is mostly a pipe.
#pragma once

#include <cstddef>

namespace candela {

inline constexpr char kStdoutName[] = "standard output";

// Writes all of them. Returns 0 or an errno; EPIPE if nobody reads any more.
int write_to_stdout(const void* bytes, size_t count);

// Writes all that the file of this descriptor holds.
int copy_to_stdout(int file);

}  // namespace candela
