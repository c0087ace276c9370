// Rows of pixels with and without alpha.
#pragma once

#include <cstddef>
#include <span>

#include "candela/v1/render.pb.h"

namespace candela::v1 {

// Copies a tight row without alpha to `place`, which holds as many pixels with an alpha of 1. The format is
// RGB16F or RGB32F.
void add_alpha(PixelFormat format, std::span<const std::byte> row, std::span<std::byte> place);
// The same for an image, of any format.
void add_alpha(OutputFormat format, std::span<const std::byte> row, std::span<std::byte> place);

// Copies a tight row of an image to `place`, which holds as many pixels of R, G and B.
void leave_out_alpha(OutputFormat format, std::span<const std::byte> row, std::span<std::byte> place);

}  // namespace candela::v1
