// Takes a PNG file from a pipe.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "client/image/image.h"
#include "client/image/read/byte_source.h"

namespace candela {

// Appends the rest of a file of which the first four bytes are in `bytes`: its chunks up to IEND. OK, too, if
// the stream ends within it. Fails, with `name`, if it does not say how long it is, or if a limit does not
// let it be taken.
absl::Status take_png(ByteSource& source, const std::string& name, const ImageLimits& limits,
                      std::string& bytes);

}  // namespace candela
