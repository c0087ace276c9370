// Converts between image files and frames on the wire.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/cli/commands/render_report.h"
#include "client/color/view_table.h"
#include "client/connection.h"
#include "client/image/image.h"
#include "client/render_result.h"

namespace candela {

// The wire format of an image as a reader returns it.
v1::PixelFormat wire_format(ImageFormat format);

// The limits for reading images for a server. A chunk of an OpenEXR file may take `max_chunk_mib`, or an
// eighth of the memory that this process may use if that is 0.
ImageLimits image_limits(const v1::Limits& server, uint64_t max_chunk_mib = 0);

// The same without a server.
ImageLimits default_image_limits();

// A view of the image's pixels; the image must outlive it.
FrameView view_of(const Image& image);

// Adds the chromaticities of the file unless the user set some.
v1::Settings settings_for(const Image& image, v1::Settings settings);

// A usage error if the file's chromaticities and --ocio-input would both convert the image. With --primaries
// the user has decided.
absl::Status check_view_input(const Image& image, const std::string& path, const v1::Settings& settings,
                              const ViewChoice& view);

// A note for who renders a picture that its file calls a cube map as a frame; "" if it is none.
std::string cube_map_note(const Image& image);

// Makes an image to write from a raw result. Alpha and pixel aspect come from the input file.
absl::StatusOr<Image> picture_of(const RenderResult& result, bool has_alpha, double pixel_aspect);

// Says which input failed, and puts its path before a server's refusal, which does not know it.
absl::Status name_file(const absl::Status& status, const std::string& path);

// A view of --ocio, baked into a table for the wire.
struct BakedView {
  v1::ColorTable table;
  ViewReport report;
  std::vector<std::string> notes;
  std::function<void(std::span<float>)> show;  // ViewTable::show
};
absl::StatusOr<BakedView> bake(const ViewChoice& choice);

}  // namespace candela
