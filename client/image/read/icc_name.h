// The name of an ICC profile. Internal to client/image.
#pragma once

#include <string>

#include "absl/strings/string_view.h"

namespace candela {

// The profile's description in ASCII: "sRGB IEC61966-2.1". Other characters are "?". "" if the
// bytes are no profile or hold no description.
std::string icc_name(absl::string_view profile);

}  // namespace candela
