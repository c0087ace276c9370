// A view of OpenColorIO as the command sends it: a colour table for the wire, and how files are read for it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/color/view_table.h"
#include "client/image/image.h"
#include "client/run/options.h"

namespace candela {

// The view of --ocio, and the error of its table against
// OpenColorIO's own code; see client/color/view_table.h.
struct ViewReport {
  std::string display;
  std::string view;
  std::string input;
  uint32_t table_size = 0;
  double table_end = 0;
  double max_codes = 0;
  double p999_codes = 0;
  double mean_codes = 0;
  std::string config;  // its path
  std::string source;  // what named it, "--ocio" or "$OCIO"
};

// "ACES", or "ACES of $OCIO" if the environment chose the view.
std::string view_words(const ViewReport& view);

// A view of --ocio, baked for the wire.
struct BakedView {
  v1::ColorTable table;  // not for data
  ViewReport report;
  ViewTable view;  // without its table and notes
  std::vector<std::string> notes;
};
// A note tells of primaries that the user gave in vain.
absl::StatusOr<BakedView> bake(const PictureOptions& options);

// Sets what a frame needs for the view: its table, or for data neither curve nor primaries.
void show_by(const BakedView& view, v1::Settings& settings);

// The picture to read. Its values stay as they stand if the user says what they are, by --primaries or
// --ocio-input, or if the view is of data. `view` is null without --ocio.
PictureChoice choice_of(const PictureOptions& options, const BakedView* view = nullptr);

// Converts an image that choice_of() chose from the colour space of --ocio-input to scene light. Colour is
// divided by alpha before and multiplied after. `view` may be null.
void enter_scene(const BakedView* view, Image& image);

}  // namespace candela
