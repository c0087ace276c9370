// An OpenColorIO configuration, as a user names it.
#pragma once

#include <OpenColorIO/OpenColorIO.h>

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/color/view_table.h"

namespace candela {

// The configuration of `choice`; of a LUT, one whose view is the LUT (lut_config.h). NOT_FOUND for a missing
// file, INVALID_ARGUMENT for one that OpenColorIO cannot use. Messages are one line. Any thread.
absl::StatusOr<OCIO_NAMESPACE::ConstConfigRcPtr> load_config(const ViewChoice& choice);

// The error for what OpenColorIO threw while it used the configuration of `choice`.
absl::Status unusable(const ViewChoice& choice, const std::exception& thrown);

// The displays, views and color spaces of a configuration.
struct ConfigViews {
  struct Display {
    std::string name;
    std::string default_view;
    std::vector<std::string> views;
  };
  std::string version;  // of its format, such as 2.1
  std::string default_display;
  std::vector<Display> displays;
  std::vector<std::string> color_spaces;  // the active ones, for ViewChoice::input
};

// Fails as load_config does. Any thread.
absl::StatusOr<ConfigViews> views_of(const ViewChoice& choice);

}  // namespace candela
