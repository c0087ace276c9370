// Panoramas from files, and what is made of them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/environment/baked_environment.h"
#include "client/image/image.h"
#include "client/panorama.h"
#include "client/run/options.h"
#include "client/run/picture_frame.h"

namespace candela {

// A panorama from an image file.

struct PanoramaFile {
  std::shared_ptr<const Panorama> panorama;
  PrimariesUsed primaries;
  std::vector<std::string> notes;
  uint64_t missing_pixels = 0;  // of the file, as in Image, and the next two
  PictureLight light = PictureLight::kScene;
  double peak = 1;
};

// Reads the picture that `options` choose from the file `path`. Its primaries are those of the options'
// settings, or else the file's; the treatment of bad values is that of the settings. A note tells of a
// picture that is far from 2:1. A cube map becomes a panorama (client/image/cube_panorama.h). `limits` are
// the server's. `view` is that of --ocio, null without it. Fails like read_image(), and with
// RESOURCE_EXHAUSTED if it is too large for a panorama.
absl::StatusOr<PanoramaFile> read_panorama(const std::string& path, const PictureOptions& options,
                                           const v1::Limits& limits, const BakedView* view = nullptr);

// The image as a panorama, with the primaries and the treatment of bad values that read_panorama() says.
std::shared_ptr<const Panorama> panorama_of(Image image, const v1::Settings& settings);

// The settings without those that belong to the panorama: its primaries and its bad values.
v1::Settings without_panorama(v1::Settings settings);

// The server's bake as an environment that the client library can write.

// `handedness` is that of cube maps in files. RESOURCE_EXHAUSTED if there is not enough memory.
absl::StatusOr<BakedEnvironment> environment_from(const EnvironmentBake& bake, Handedness handedness);

// A picture of all levels of a baked environment.

// The crosses of the levels side by side, as light. Faces larger than 256 texels are reduced to that: each
// pixel is the mean of the texels that it stands for. Fails like cross_picture().
absl::StatusOr<Image> environment_preview(const BakedEnvironment& environment);

// The default settings, but for what is between the crosses: it is not metered, and nothing shines on it.
v1::Settings preview_settings();

}  // namespace candela
