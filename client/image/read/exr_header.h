// A first look at an OpenEXR header, before OpenEXR itself gets to see it.
#pragma once

#include "absl/status/status.h"
#include "client/image/read/file_reader.h"

namespace candela {

// OpenEXR 3.1 takes memory for an attribute by the size that the file claims, gigabytes from a file of 200
// bytes. This walks over the attributes of every part, in the file's layout (technical introduction to
// OpenEXR, "file layout"), and is INVALID_ARGUMENT when one is larger than the rest of the file or the header
// does not end. Values are OpenEXR's to judge.
absl::Status check_exr_header(FileReader& file);

}  // namespace candela
