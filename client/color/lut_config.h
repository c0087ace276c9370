// A look-up table's file as an OpenColorIO configuration.
#pragma once

#include <OpenColorIO/OpenColorIO.h>

#include "client/color/view_table.h"

namespace candela {

// A configuration whose only view shows scene light through the file of `choice`, which is a LUT. Throws
// OpenColorIO's exceptions if this version lacks the input space. `choice.lut_input` is one of the words. Any
// thread.
OCIO_NAMESPACE::ConstConfigRcPtr lut_config(const ViewChoice& choice);

}  // namespace candela
