// Checks an OpenEXR header before OpenEXR reads it.
#pragma once

#include "absl/status/status.h"
#include "client/image/read/file_reader.h"

namespace candela {

// OpenEXR 3.1 allocates as much memory for an attribute as the file claims, which may be gigabytes for a file
// of 200 bytes. This function walks over the attributes of every part (see "file layout" in the Technical
// Introduction to OpenEXR). It returns INVALID_ARGUMENT if an attribute is larger than the rest of the file
// or the header does not end, and UNIMPLEMENTED if this OpenEXR does not know the version of the format or a
// part's compression. It leaves checking the other values to OpenEXR.
absl::Status check_exr_header(FileReader& file);

}  // namespace candela
