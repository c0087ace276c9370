// Bakes a view of an OpenColorIO configuration into a colour table.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "shaders/color_table.h"

namespace candela {

struct ViewChoice {
  std::string config = {};   // a file: .ocio or another kind that OpenColorIO reads, or a LUT
  std::string display = {};  // empty: the configuration's default
  std::string view = {};     // empty: the display's default
  std::string input = {};   // colour space of the file's own values; empty: they are light of known primaries
  std::string source = {};  // what named the configuration, "--ocio", "--lut" or "$OCIO"
  std::string lut_input = {};  // not empty: `config` is a LUT, of values in this space
  // The values at the LUT's ends, the first below the second; absent: what its file says, or 0 and 1.
  std::optional<std::pair<double, double>> lut_domain = {};
};

// The words for ViewChoice::lut_input. The first is the default, linear light.
std::vector<std::string> lut_inputs();

struct ViewTable {
  // The view is one of data: OpenColorIO shows the file's own values, so there is no table.
  bool as_is = false;
  ColorTable table;
  std::string display;
  std::string view;
  std::string
      input;  // the colour space in which values enter the configuration; "" for data without a choice
  // OpenColorIO's own CPU renderer of the view: exposed scene light (Rec.709, linear, outside of its gamut
  // also negative) to display values in place, R, G, B, R, G, B ... Any thread.
  std::function<void(std::span<float>)> show;
  // With ViewChoice::input, OpenColorIO's own renderers of the file's values, in place and in any thread: to
  // scene light (Rec.709, linear), which is null if the values are such light, and to display values.
  // Otherwise both null.
  std::function<void(std::span<float>)> to_scene;
  std::function<void(std::span<float>)> show_input;
  // The difference between the table and `show`, for greys and many colours from 2^-12 to 2^8 between the
  // table's points, a part of them outside of Rec.709 (see measure()), in 1/255 of the view's range.
  double max_codes = 0.0;
  double p999_codes = 0.0;
  double mean_codes = 0.0;
  std::vector<std::string> notes;  // assumptions, for the user
};

// Bakes the view into the largest table that the protocol allows. Takes a fraction of a second. The scene's
// Rec.709 values enter as find_entry() says (view_config.h). With ViewChoice::input the file's values are
// first converted to such light, because a table has axes for wide-gamut light only if it knows its
// primaries. The kind of axes is the one with the smallest error. They end where brighter light no longer
// changes the view.
//
// Returns NOT_FOUND for a missing file, display, view or colour space, with a list of those that exist, and
// INVALID_ARGUMENT for a file that is not a configuration or a view that cannot be computed. Messages are one
// line. Any thread.
absl::StatusOr<ViewTable> bake_view(const ViewChoice& choice);

}  // namespace candela
