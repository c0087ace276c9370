// The seeds of the fuzz targets.
#pragma once

#include <string>

namespace candela {

// Each writes its files into a folder that there is.
void write_image_seeds(const std::string& folder);
void write_wire_seeds(const std::string& folder);

}  // namespace candela
