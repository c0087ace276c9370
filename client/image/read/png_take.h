// Takes a PNG file from a pipe.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "client/image/image.h"
#include "client/image/read/byte_source.h"

namespace candela {

// Reads the rest of a file, whose first four bytes are in `bytes`, and appends it: the chunks up to IEND.
// Also OK if the stream ends within the file. Fails if the file does not say how long it is, or is larger
// than a limit. `name` names the file in the error.
absl::Status take_png(ByteSource& source, const std::string& name, const ImageLimits& limits,
                      std::string& bytes);

}  // namespace candela
