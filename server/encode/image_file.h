// Rendered frames as image files, in memory.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/encode/picture.h"

namespace candela {

// Whether an image that is rendered with these settings has the frame's alpha.
bool keeps_alpha(const v1::Settings& settings);

// The transfer that the codes of an image with these settings are encoded with. A client's table has its own.
EncodedTransfer encoded_transfer(const v1::Settings& settings);

// Encodes a picture that was rendered with `settings`, which are complete. `opaque` says that every alpha of
// the frame was 1. `encoding` is PNG or JPEG. A PNG has 8 or 16 bits, chunks for its transfer function, and
// alpha unless the frame was opaque or the settings make the image so: its codes never decide, because those
// of a faint frame may all be 0. A JPEG has 8 bits, 4:4:4 and no alpha; `quality` is 1 .. 100. Any thread; it
// takes no other, because those that encode have frames of their own. Takes tens of milliseconds for a large
// frame.
absl::StatusOr<std::string> encode_image(const PictureView& picture, const v1::Settings& settings,
                                         bool opaque, v1::Encoding encoding, int quality);

}  // namespace candela
