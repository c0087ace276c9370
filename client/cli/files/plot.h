// Plots, drawn by gnuplot in a child process.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace candela {

// FAILED_PRECONDITION with the package to install if gnuplot cannot be run.
absl::Status check_gnuplot();

// Runs a gnuplot script that plots once and sets neither terminal nor output, and returns the plot as an
// <svg> element. Width and height are in the unit in which the labels' font is 13 high. INTERNAL with
// gnuplot's message if gnuplot does not accept the script.
absl::StatusOr<std::string> plot_svg(const std::string& name, int width, int height,
                                     const std::string& script);

// Does the same and returns the bytes of a PNG file. Width and height are in pixels.
absl::StatusOr<std::string> plot_png(int width, int height, const std::string& script);

// Puts a string in single quotes for gnuplot.
std::string quoted_for_plot(const std::string& text);

}  // namespace candela
