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

}  // namespace candela
