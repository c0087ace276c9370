// The frame rate in an OpenEXR header.
#pragma once

#include <OpenEXR/ImfHeader.h>

#include <optional>

#include "client/image/frame_rate.h"

namespace candela {

// The rate that the attribute framesPerSecond says, in any case. OpenEXR defines it as a rational;
// OpenImageIO also writes an integer, a float, a double, a text such as "24000/1001" or "23.976", or a pair
// of numbers, as it was given. A decimal number near a film rate is that rate, as OpenEXR's guessExactFps()
// says: 23.976 is 24000/1001. If several attributes have the name, the one in OpenEXR's own case comes first.
// Nothing if none is a positive number.
std::optional<FrameRate> frame_rate_of(const Imf::Header& header);

}  // namespace candela
