// The rows of a PNG and their filters (PNG, chapter 9). Highway chooses the instruction set at run time; the
// results do not depend on it. Internal to server/encode.
#pragma once

#include <cstddef>
#include <cstdint>

namespace candela {

// A row of a PNG lies between this many bytes of memory on either side, because vectors reach beyond it.
inline constexpr size_t kPngMargin = 64;

// Packs pixels of RGBA, 16 bits per component in the machine's byte order if `wide`, else 8, into a row of a
// PNG: without the fourth component unless `alpha`, 16 bits with the high byte first.
void pack_png_row(const std::byte* rgba, uint32_t pixels, bool wide, bool alpha, uint8_t* row);

// Filters a row by whichever of Sub, Up, Average and Paeth leaves the least sum of magnitudes; the first of
// those if several do. Writes the filter's number and `bytes` bytes to `out`, and anything to the margin
// after them. `above` is the packed row above, or zeros. The margins before `row` and `above` are zeros.
void filter_png_row(const uint8_t* row, const uint8_t* above, size_t bytes, size_t pixel_bytes, uint8_t* out);

}  // namespace candela
