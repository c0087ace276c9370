// The sizes of a frame and of its image, and the shapes of their pixels.
#pragma once

#include <string>

#include "candela/v1/render.pb.h"
#include "client/image/image.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// Gives the settings the frame's pixel aspect, so that its image has square pixels. Says so, or why its
// pixels stay as they are.
std::string desqueeze(const Image& frame, v1::Settings& settings);

// The width of the image's pixels over their height, if the frame's have `pixel_aspect`: the image shows the
// frame's shape, unless the settings make its pixels square.
double image_pixel_aspect(v1::ImageSize frame, double pixel_aspect, const v1::OutputSize& asked);

// A note if the settings ask for another shape than the frame's; else "".
std::string shape_note(v1::ImageSize frame, const v1::OutputSize& asked);

// "480x270 of 3840x2160", or "3840x2160" if the frame has that size.
std::string size_words(v1::ImageSize image, v1::ImageSize frame);

}  // namespace candela
