// Plots, drawn by gnuplot as a child process.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace candela {

// OK where gnuplot can be run; else FAILED_PRECONDITION that names the package to install.
absl::Status check_gnuplot();

// What `script` draws, as an <svg> element to stand in a page. `name` makes the element's ids its own within
// the page: letters and digits. The script plots once and sets neither terminal nor output. Width and height
// are in points of the labels' font, which is 13 high; the element scales with its place. INTERNAL, with
// gnuplot's words, for a script it does not understand.
absl::StatusOr<std::string> plot_svg(const std::string& name, int width, int height,
                                     const std::string& script);

// The same as the bytes of a PNG file; width and height in pixels.
absl::StatusOr<std::string> plot_png(int width, int height, const std::string& script);

// A string as gnuplot takes it in single quotes.
std::string quoted_for_plot(const std::string& text);

}  // namespace candela
