// Tells the user that the curve cut a part of the picture's colours.
#pragma once

#include <optional>
#include <string>

#include "candela/v1/render.pb.h"

namespace candela {

// A sentence if more than 1 % of the image's R, G and B components lie outside of the gamut of the curve,
// with what to do about it. `settings` are those that were sent.
std::optional<std::string> gamut_note(const v1::ResultHeader& result, const v1::Settings& settings);

}  // namespace candela
