// A plot of a sequence's exposure over media time, as an .svg file.
#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/run/exposure_file.h"

namespace candela {

// Checks before the work that the plot can be written. A usage error for another extension than .svg.
absl::Status check_plot(const std::string& path);

// Draws exposure, target and mean luminance, in EV, and marks cuts. There is at least one frame.
absl::Status plot_exposure(const std::vector<ExposedFrame>& curve, const std::string& path);

}  // namespace candela
