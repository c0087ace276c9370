// Vector kernels for the chunks of an OpenEXR file. Highway chooses the instruction set when they run. The
// sizes are any; nothing needs to be aligned.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace candela {

// Undoes OpenEXR's predictor in place: each byte is 128 less than its difference to the one before.
void undo_predictor(std::span<uint8_t> bytes);

// Bytes 0, 2, 4 ... of `out` come from `even`, and 1, 3, 5 ... from `odd`.
void interleave_bytes(const uint8_t* even, const uint8_t* odd, std::span<uint8_t> out);

// Where a row's red, green, blue and alpha begin, each little endian and one after the other; null: there is
// none, and it becomes 0, or 1 for alpha.
using RowPlanes = std::array<const uint8_t*, 4>;

// Writes `pixels` of four halves, or of four floats.
void halves_to_rgba(const RowPlanes& planes, std::byte* rgba, size_t pixels);
void floats_to_rgba(const RowPlanes& planes, std::byte* rgba, size_t pixels);

}  // namespace candela
