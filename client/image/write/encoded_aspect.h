// Pixel aspect in PNG and JPEG files that a server made. It knows no aspect, so it writes square pixels.
#pragma once

#include <cstddef>
#include <span>

#include "client/image/write/atomic_file.h"

namespace candela {

// The note for the user about a JPEG of an image with alpha.
inline constexpr char kNoAlphaInJpeg[] = "alpha dropped: .jpg has none";

// Writes the PNG or JPEG `encoded`. If the pixels are not square, it says so as write_image() does: in a pHYs
// chunk before the pixels, or in the JFIF density. Bytes of another kind are written as they are.
void write_with_aspect(AtomicFile& file, std::span<const std::byte> encoded, double pixel_aspect);

}  // namespace candela
