// What the names of parts and layers in OpenEXR files say about their pictures.
#pragma once

#include <string>

#include "absl/strings/string_view.h"

namespace candela {

// How well a picture's name says that it is the one to show. The smaller, the better.
struct PictureRank {
  enum class Kind {
    kPicture,  // no name, or one of rgba, rgb, beauty, combined, C, Ci, colour, color
    kUnknown,  // any other name
    kData,     // normals, depth, occlusion, identifiers, positions, masks and their like
  };
  Kind kind = Kind::kPicture;
  int order = 0;  // among those of its kind
};

// The rank of the name of a part or a layer. The last of its pieces, between dots, counts. Words such as
// main, or the name of its view, change nothing. Upper and lower case are the same.
PictureRank rank_of_name(absl::string_view name, absl::string_view view);

// The rank of a layer in a part, by the names of both. The name of a file's only part counts as none.
PictureRank rank_of_picture(absl::string_view part, absl::string_view layer, absl::string_view view);

}  // namespace candela
