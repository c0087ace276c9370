// A configuration of OpenColorIO: found, read, and where scene light enters it.
#pragma once

#include <OpenColorIO/OpenColorIO.h>

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/color/view_table.h"

namespace candela {

struct ViewEntry {
  OCIO_NAMESPACE::GroupTransformRcPtr from_rec709;  // linear Rec.709 to the colour space; may be empty
  std::string space;
  std::vector<std::string> notes;  // assumptions
};

// Appends one of OpenColorIO's builtin transforms.
void append_builtin(const OCIO_NAMESPACE::GroupTransformRcPtr& group, const char* style,
                    OCIO_NAMESPACE::TransformDirection direction);

// Takes ACES2065-1 if the configuration has the role aces_interchange, else a colour space named like linear
// Rec.709, or else the role scene_linear, which is taken to be linear Rec.709. Assumptions are noted.
// NOT_FOUND if there is none of these, and INVALID_ARGUMENT if the role names a colour space that is not
// there.
//
// With choice.input, at exposure 1 the entry changes nothing that is seen, so there are no notes and no
// errors. Then colour spaces named like ACES2065-1 and ACEScg are entries, too, and the last one is the input
// itself. NOT_FOUND if the configuration lacks it.
absl::StatusOr<ViewEntry> find_entry(const OCIO_NAMESPACE::ConstConfigRcPtr& config,
                                     const ViewChoice& choice);

// An OpenColorIO configuration, as a user names it.

// The configuration of `choice`; of a LUT, one whose view is the LUT. NOT_FOUND for a missing
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
