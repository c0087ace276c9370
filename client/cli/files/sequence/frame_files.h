// Converts between image files and frames on the wire.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/cli/commands/render/render_report.h"
#include "client/cli/options/options.h"
#include "client/color/view_table.h"
#include "client/connection.h"
#include "client/image/image.h"
#include "client/render_result.h"

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

// Adds the chromaticities of the file unless the user set some.
v1::Settings settings_for(const Image& image, v1::Settings settings);

// A note for who renders a picture that its file calls a cube map as a frame; "" if it is none.
std::string cube_map_note(const Image& image);

// Makes an image to write from a raw result. Alpha and pixel aspect come from the input file.
absl::StatusOr<Image> picture_of(const RenderResult& result, bool has_alpha, double pixel_aspect);

// Says which input failed, and puts its path before a server's refusal, which does not know it.
absl::Status name_file(const absl::Status& status, const std::string& path);

// A view of --ocio, baked for the wire.
struct BakedView {
  v1::ColorTable table;  // not for data
  ViewReport report;
  ViewTable view;  // without its table and notes
  std::vector<std::string> notes;
};
// A note tells of primaries that the user gave in vain.
absl::StatusOr<BakedView> bake(const PictureOptions& options);

// Sets what a frame needs for the view: its table, or for data neither curve nor primaries.
void show_by(const BakedView& view, v1::Settings& settings);

// The picture to read. Its values stay as they stand if the user says what they are, by --primaries or
// --ocio-input, or if the view is of data. `view` is null without --ocio.
PictureChoice choice_of(const PictureOptions& options, const BakedView* view = nullptr);

// Converts an image that choice_of() chose from the colour space of --ocio-input to scene light. Colour is
// divided by alpha before and multiplied after. `view` may be null.
void enter_scene(const BakedView* view, Image& image);

// As what an image that choice_of() chose is rendered.
PrimariesUsed primaries_of(const Image& image, const v1::Settings& given, const BakedView* view);

}  // namespace candela
