// The limits of an OpenEXR picture, which its header is checked against before memory is allocated.
#pragma once

#include <OpenEXR/ImfCompression.h>
#include <OpenEXR/ImfHeader.h>

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "client/image/image.h"
#include "client/image/read/exr/exr_channels.h"

namespace candela {

// The scan lines in a chunk of this compression.
int64_t rows_of_chunk(Imf::Compression compression);

// The bytes that OpenEXR decodes at a time, for a header that check_exr_picture() accepts.
uint64_t chunk_bytes(const Imf::Header& header);

// The format that these channels are read to: halves only if all of them are.
ImageFormat exr_format(const Imf::Header& header, const ExrChannels& channels);

// RESOURCE_EXHAUSTED if the windows or chunks exceed the limits, INVALID_ARGUMENT for an empty window,
// UNIMPLEMENTED for channels that are subsampled in an unusual way. Errors name `path`.
absl::Status check_exr_picture(const std::string& path, const Imf::Header& header,
                               const ExrChannels& channels, const ImageLimits& limits);

}  // namespace candela
