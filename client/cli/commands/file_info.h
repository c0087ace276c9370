// Describes image files, for `candela info FILE...`.
#pragma once

#include <string>

#include "client/image/describe.h"

namespace candela {

// Several lines, each with a line end.
std::string to_text(const std::string& path, const FileFacts& facts);

// One object on one line, with the keys file, kind, shown (null if nothing can be rendered), error (null if
// something can), notes and parts. A part has the keys name, storage, compression, display_window and
// data_window {left, top, right, bottom}, pixel_aspect, frames_per_second (null if the file names none),
// primaries {name, xy} (null if the file names none; name null if they have none), views, layers, and
// channels {name, type, x_sampling, y_sampling}.
std::string to_json(const std::string& path, const FileFacts& facts);

}  // namespace candela
