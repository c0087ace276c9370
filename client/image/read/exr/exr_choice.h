// Chooses the picture of an OpenEXR file: a part, and channels in it.
#pragma once

#include <OpenEXR/ImfMultiPartInputFile.h>

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "client/image/read/exr/exr_channels.h"

namespace candela {

// Adds a name that is not empty and not there yet.
void add_once(std::vector<std::string>& names, const std::string& name);

struct ExrPicture {
  int part = 0;  // counted from 0
  ExrChannels channels;
  std::vector<std::string> notes;  // what the reader chose where there is more than one picture
};

// Takes, of the parts, views and layers that `choice` allows and that have colour, the one whose name says
// best that it is the picture (exr_picture_rank.h), and among equals the first. Without any, it takes a part
// with a single channel besides alpha, and, if the user chose a part, a view or a layer, also a vector or a
// single channel. The layer RGB or RGBA means the channels without a layer, if no layer and no channel has
// this name, and XYZ means X, Y and Z without a layer, as CIE XYZ. A note says what is shown if there is more
// to see, and the options that show the rest. NOT_FOUND for a part, layer or view that is not there, with a
// list of those that are, INVALID_ARGUMENT if there is nothing to show, and UNIMPLEMENTED for deep images.
// Errors name `path`.
absl::StatusOr<ExrPicture> choose_exr_picture(const std::string& path, const Imf::MultiPartInputFile& file,
                                              const PictureChoice& choice);

bool is_deep(const Imf::Header& header);

}  // namespace candela
