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

// What a file of an image with these settings, whose transfer is PQ or HLG, says of it. The light is that of
// ResultHeader.
HdrDisplay hdr_display(const v1::Settings& settings, double max_light_nits, double mean_light_nits);

// What rendering found out about an image, and its file says.
struct ImageFacts {
  HdrDisplay hdr{};              // with PQ and HLG
  double gain_map_max_log2 = 0;  // above 0: the fourth component is a gain map's, as ResultHeader says
};

// Encodes a picture that was rendered with `settings`, which are complete.
// `opaque` says that every alpha of the frame was 1. `encoding` is PNG or JPEG. A PNG has 8 or 16 bits,
// chunks for its transfer function, and alpha unless the frame was opaque or the settings make the image so:
// its codes never decide, because those of a faint frame may all be 0. A JPEG has 8 bits, 4:4:4 and no alpha;
// `quality` is 1 .. 100. Any thread; it takes no other, because those that encode have frames of their own.
// Takes tens of milliseconds for a large frame.
absl::StatusOr<std::string> encode_image(const PictureView& picture, const v1::Settings& settings,
                                         const ImageFacts& facts, bool opaque, v1::Encoding encoding,
                                         int quality);

}  // namespace candela
