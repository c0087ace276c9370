// Converts between image files and frames on the wire.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/connection.h"
#include "client/image/image.h"
#include "client/render_result.h"
#include "client/run/options.h"
#include "client/run/picture/baked_view.h"
#include "client/run/picture/primaries_used.h"

namespace candela {

// The wire format of an image as a reader returns it.
v1::PixelFormat wire_format(ImageFormat format);

// The limits for reading images for a server: what it takes, and no more pixels than the options allow. A
// chunk of an OpenEXR file may take options.max_chunk_mib, or an eighth of the memory that this process may
// use if that is 0.
ImageLimits image_limits(const v1::Limits& server, const PictureOptions& options);

// The same without a server.
ImageLimits default_image_limits();

// A view of the image's pixels; the image must outlive it.
FrameView view_of(const Image& image);

// Whether the user says what the primaries of the input are.
bool has_primaries(const v1::Settings& settings);

// CIE xy of red, green, blue and white.
v1::Chromaticities to_message(const std::array<float, 8>& xy);

// Adds the chromaticities of the file unless the user set some.
v1::Settings settings_for(const Image& image, v1::Settings settings);

// Light of a display is shown at 0 EV and without bloom, unless the settings say something of exposure or
// bloom.
void show_display_light(const Image& image, v1::Settings& settings);

// How the image of this result is written: an HDR one says how bright it is, and a JPEG may have a gain map.
WriteOptions write_options_for(WriteOptions options, const v1::ResultHeader& result);

// Makes an image to write from a raw result. Alpha and pixel aspect come from the input file.
Image picture_of(RenderResult result, bool has_alpha, double pixel_aspect);

// Says which input failed, and puts its path before a server's refusal, which does not know it.
absl::Status name_file(const absl::Status& status, const std::string& path);

// As what an image that choice_of() chose is rendered.
PrimariesUsed primaries_of(const Image& image, const v1::Settings& given, const BakedView* view);

}  // namespace candela
