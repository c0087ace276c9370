// Finds the gain map of a JPEG file and what its codes mean. Internal to client/image.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/encode/gain_map.h"
#include "server/encode/jpeg_segments.h"

namespace candela {

struct FoundGainMap {
  absl::string_view jpeg;    // within the file; empty: the file has no gain map
  GainMapMetadata metadata;  // all three channels are filled
};

// Looks for the map by MPF, then by Google's Container directory. Its metadata is ISO 21496-1, or else
// Adobe's XMP. `segments` are those of `file`. Adds a note if the file mentions a map and does not say where
// it is. INVALID_ARGUMENT, whose message does not name the file, if the place is not in the file, or the
// metadata is damaged, or makes an SDR picture of an HDR one.
absl::StatusOr<FoundGainMap> find_gain_map(absl::string_view file, const JpegSegments& segments,
                                           std::vector<std::string>& notes);

}  // namespace candela
