// Decodes a scan line of a Radiance file: flat, run-length coded by component, or by pixel as before 1991.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "client/image/read/file_reader.h"

namespace candela {

using Rgbe = std::array<uint8_t, 4>;  // three mantissas and their common exponent

// Fills `line`, which has the scan line's length. `index` is for error messages. Returns INVALID_ARGUMENT if
// the file ends within the line or its runs do not fit the length.
absl::Status read_scanline(FileReader& file, int64_t index, std::span<Rgbe> line);

}  // namespace candela
