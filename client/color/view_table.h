// Bakes a view of an OpenColorIO configuration into a colour table.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "shaders/color_table.h"

namespace candela {

struct ViewChoice {
  std::string config;   // a file: .ocio or another kind that OpenColorIO reads
  std::string display;  // empty: the configuration's default
  std::string view;     // empty: the display's default
  std::string input;    // colour space of the scene's linear Rec.709 values; empty: found by bake_view()
};

struct ViewTable {
  ColorTable table;
  std::string display;
  std::string view;
  std::string input;  // the colour space in which the scene entered the configuration
  // The difference between the table and OpenColorIO's CPU renderer, for greys and many colours from 2^-12 to
  // 2^8 between the table's points, in 1/255 of the view's range.
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
  std::vector<std::string> notes;  // assumptions, for the user
};

// Bakes the view into the largest table that the protocol allows. Takes a fraction of a second. The scene's
// Rec.709 values enter through ACES2065-1 if the configuration has the role aces_interchange. Otherwise they
// enter as a colour space named like linear Rec.709, or else as the role scene_linear, with a note. The axes
// end where brighter light no longer changes the view.
//
// Returns NOT_FOUND for a missing file, display, view or colour space, with a list of those that exist, and
// INVALID_ARGUMENT for a file that is not a configuration or a view that cannot be computed. Messages are one
// line. Any thread.
absl::StatusOr<ViewTable> bake_view(const ViewChoice& choice);

}  // namespace candela
