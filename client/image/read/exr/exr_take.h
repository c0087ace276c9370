// Takes an OpenEXR file from a pipe.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "client/image/image.h"
#include "client/image/read/byte_source.h"

namespace candela {

// Reads the rest of a file of one part, whose first four bytes are in `bytes`, and appends it. The file's
// header and chunks say where it ends; chunks may come in any order. Also OK if the stream ends within the
// file. Fails if the file does not say how long it is, or is larger than a limit. `name` names the file in
// the error.
absl::Status take_exr(ByteSource& source, const std::string& name, const ImageLimits& limits,
                      std::string& bytes);

}  // namespace candela
