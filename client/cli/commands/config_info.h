// Describes an OpenColorIO configuration, for `candela info --ocio CONFIG`.
#pragma once

#include <string>

#include "client/color/view_config.h"

namespace candela {

// A line for the configuration and one for each display, each with a line end.
std::string to_text(const std::string& path, const ConfigViews& config);

// One object on one line, with the keys config, version, default_display, displays (of name, default_view and
// views) and color_spaces.
std::string to_json(const std::string& path, const ConfigViews& config);

}  // namespace candela
