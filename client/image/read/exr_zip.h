// Reads the scan lines of ZIP and ZIPS parts. OpenEXR's library checks the file and hands over its chunks as
// they are stored; libdeflate and vector kernels make them pixels.
//
// Damage is refused as OpenEXR refuses it, and two kinds more: a chunk of no bytes, and one that does not
// inflate to exactly its rows. Of a picture that is read in chunks, OpenEXR also loses the one after a chunk
// whose header is damaged; this does not. Of streams that no compressor writes, libdeflate reads some that
// zlib refuses (length codes 286 and 287, distance codes 30 and 31), if their checksum is right.
#pragma once

#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>

#include "client/image/image.h"
#include "client/image/read/exr_file.h"

namespace candela {

// Whether zip_rows() reads the part: scan lines, ZIP or ZIPS, and all channels at full sampling.
bool has_zip_rows(const Imf::Header& header);

// `threads` of OpenEXR's pool decode chunks side by side, each with the memory of two; with less than two,
// the caller decodes one chunk at a time. The header has passed check_exr_picture(). Of several damaged
// chunks the first in the file's order is the one that is thrown. `input` must outlive what this returns.
ReadRows zip_rows(Imf::InputPart& input, const ExrChannels& channels, ImageFormat format, int threads);

}  // namespace candela
