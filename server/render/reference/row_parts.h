// Work on the rows of an image, on every core.
#pragma once

#include <cstdint>
#include <functional>

namespace candela {

// The number of parts to split the rows into: one for each usable core, at most one for each row.
uint32_t row_parts(uint32_t height);

// Runs work(first, last, part) for each of `parts` parts of the rows, each on a separate thread. Returns
// when all are done.
void for_row_parts(uint32_t height, uint32_t parts,
                   const std::function<void(uint32_t first, uint32_t last, uint32_t part)>& work);

}  // namespace candela
