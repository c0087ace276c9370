// A frame's alpha in the command: the treatment that an image gets by default.
#pragma once

#include <string>

#include "candela/v1/render.pb.h"
#include "client/image/image.h"
#include "server/encode/image_file.h"

namespace candela {

// Some renderers and games leave alpha 0 everywhere although there is light. Then it means nothing: such a
// frame is taken as opaque, and this says so. The frame's own values decide, before anything is exposed or
// quantised: a dark or faint frame with some alpha keeps it. `frame` is as read_image() returns it, halves or
// floats. Returns a note for the user; empty if nothing changed. Call it only if PictureOptions or
// MeterOptions say ignore_empty_alpha.
std::string ignore_empty_alpha(const Image& frame, v1::Settings& settings);

}  // namespace candela
