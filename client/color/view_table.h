// Bakes a view of an OpenColorIO configuration into a colour table.
#pragma once

#include <functional>
#include <span>
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
  // OpenColorIO's own CPU renderer of the view: exposed scene light (Rec.709, linear, outside of its gamut
  // also negative) to display values in place, R, G, B, R, G, B ... Any thread.
  std::function<void(std::span<float>)> show;
  // The difference between the table and `show`, for greys and many colours from 2^-12 to 2^8 between the
  // table's points, a part of them outside of Rec.709 (see measure()), in 1/255 of the view's range.
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
  std::vector<std::string> notes;  // assumptions, for the user
};

// Bakes the view into the largest table that the protocol allows. Takes a fraction of a second. The scene's
// Rec.709 values enter through ACES2065-1 if the configuration has the role aces_interchange. Otherwise they
// enter as a colour space named like linear Rec.709, or else as the role scene_linear, with a note. The kind
// of axes is the one with the smallest error. They end where brighter light no longer changes the view.
//
// Returns NOT_FOUND for a missing file, display, view or colour space, with a list of those that exist, and
// INVALID_ARGUMENT for a file that is not a configuration or a view that cannot be computed. Messages are one
// line. Any thread.
absl::StatusOr<ViewTable> bake_view(const ViewChoice& choice);

}  // namespace candela
