// Reads a part of an OpenEXR file that is unfinished or damaged: what there is of it.
#pragma once

#include <OpenEXR/ImfMultiPartInputFile.h>

#include <cstdint>

#include "client/image/image.h"
#include "client/image/read/exr/exr_channels.h"

namespace candela {

struct Gaps {
  bool unfinished = false;  // chunks were never written; false: the file has all, and some cannot be decoded
  uint64_t missing = 0;     // pixels of the picture that cannot be read
  uint64_t pixels = 0;      // pixels of the picture that the part should store
};

// Reads the part chunk by chunk into `image`, which has the size of the display window, is 0 everywhere, and
// keeps that where a chunk cannot be read. With `image` null it only counts. `channels` are not
// luminance-chroma. `file` has not been read from. Throws std::bad_alloc.
Gaps read_with_gaps(Imf::MultiPartInputFile& file, int part, const ExrChannels& channels, Image* image);

}  // namespace candela
