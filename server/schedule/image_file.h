// A rendered frame as an image file, in memory.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/render/renderer.h"
#include "server/render/settings/settings.h"

namespace candela {

// Values are those of candela.v1.Encoding.
enum class Encoding { kRaw = 1, kPng = 2, kJpeg = 3 };

// The image of `memory`, rendered with `settings`, as a file of that kind, which is not kRaw. PNG: 8 or 16
// bit, with alpha unless that is the same everywhere, the transfer named in its chunks. JPEG: 8 bit, 4:4:4,
// no alpha; `quality` 1 .. 100. Any thread; takes tens of milliseconds for a large frame.
absl::StatusOr<std::string> encode_image(const FrameMemory& memory, const Settings& settings,
                                         Encoding encoding, int quality);

}  // namespace candela
