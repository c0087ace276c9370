// Says that a limit of the settings held an exposure.
#pragma once

#include <string>

namespace candela {

// "exposure held at --max-exposure 64; it would have been 812", if a limit held it; else empty. Both factors
// are those of a result; a server that does not know the second leaves it 0.
std::string held_words(double target, double target_before_limits);

}  // namespace candela
