// The pixels of a PNG file. Internal to server/encode.
#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "server/encode/picture.h"

namespace candela {

// Writes the IDAT chunks of a picture whose size, depth and colour type (RGBA if `alpha`, else RGB; not
// interlaced) are already in the file. `threads` is that of PngOptions; each has memory of its own: 1.1 MB,
// or about that and five rows if they are long. The bytes depend on the picture alone.
//
// `sink` gets one chunk after the other, from any of the threads but never from two at the same time.
// INTERNAL if it returned false or memory ran out; it is not called again then.
absl::Status write_png_pixels(const PictureView& picture, bool alpha, uint32_t threads, ByteSink sink);

// Why the sink did not take the bytes; null if it did.
const char* send_to(ByteSink sink, const void* bytes, size_t count);

}  // namespace candela
