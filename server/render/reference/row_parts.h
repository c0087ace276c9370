// Work on the rows of an image, on every core.
#pragma once

#include <cstdint>
#include <functional>

namespace candela {

// Texels first <= x < last of row y.
struct RowSpan {
  uint32_t y;
  uint32_t first;
  uint32_t last;
};

// The number of parts to split the rows into: one for each usable core, at most one for each row.
uint32_t row_parts(uint32_t height);

// Runs work(span, part) for all texels of a width x height image. Each of `parts` parts of the rows is done
// by one thread at a time, row by row and from left to right; a span has at most some thousand texels. Goes
// through checkpoints between spans, on the calling thread and with no other thread at work. Where the system
// gives no thread, the calling thread does the part. Returns when all are done.
void for_row_parts(uint32_t width, uint32_t height, uint32_t parts,
                   const std::function<void(const RowSpan& span, uint32_t part)>& work);

}  // namespace candela
