// A view of an OpenColorIO configuration as a colour table.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "shaders/color_table.h"

namespace candela {

struct ViewChoice {
  std::string config;   // a file, .ocio or what else OpenColorIO reads
  std::string display;  // empty: the configuration's default
  std::string view;     // empty: the display's default
  std::string
      input;  // colour space that the scene's linear Rec.709 values are taken to be in; empty: found out
};

struct ViewTable {
  ColorTable table;
  std::string display;
  std::string view;
  std::string input;  // the colour space in which the configuration got the scene
  // The table against OpenColorIO's CPU code between its points, on greys and on colours of all kinds from
  // 2^-12 to 2^8, in 1/255 of the view's range.
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
  std::vector<std::string> notes;  // what was assumed
};

// Bakes the view with the largest table that the wire takes; a fraction of a second. The scene's Rec.709 goes
// by ACES2065-1 where the configuration has the role aces_interchange; else as a colour space whose name says
// linear Rec.709; else as the role scene_linear, with a note. The axes end where the view does not change any
// more.
//
// NOT_FOUND for a file, display, view or colour space that is not there, naming those that are;
// INVALID_ARGUMENT for a file that is no configuration or a view that cannot be computed. One line.
absl::StatusOr<ViewTable> bake_view(const ViewChoice& choice);

}  // namespace candela
