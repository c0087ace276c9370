// Rendered frames as image files, in memory.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/render/renderer.h"
#include "server/render/settings/settings.h"

namespace candela {

// Encodes the image of `memory`, which was rendered with `settings`. `opaque` says that every alpha of the
// frame was 1. `encoding` is not kRaw. A PNG has 8 or 16 bits, chunks for its transfer function, and alpha
// unless the frame was opaque or the settings make the image so: its codes never decide, because those of a
// faint frame may all be 0. A JPEG has 8 bits, 4:4:4 and no alpha; `quality` is 1 .. 100. Any thread. Takes
// tens of milliseconds for a large frame.
absl::StatusOr<std::string> encode_image(const FrameMemory& memory, const Settings& settings,
                                         bool opaque, v1::Encoding encoding, int quality);

}  // namespace candela
