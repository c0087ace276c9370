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
#include "client/cli/options/options.h"
#include "client/color/view_table.h"
#include "client/connection.h"
#include "client/image/image.h"
#include "client/render_result.h"

namespace candela {

// The wire format of an image as a reader returns it.
v1::PixelFormat wire_format(ImageFormat format);

// What an image may have: what the server takes, and no more pixels than the options allow.
ImageLimits image_limits(const v1::Limits& server, const PictureOptions& options);

// A view of the image's pixels; the image must outlive it.
FrameView view_of(const Image& image);

// Adds the chromaticities of the file unless the user set some.
v1::Settings settings_for(const Image& image, v1::Settings settings);

// A usage error if the file's chromaticities and --ocio-input would both convert the image. With --primaries
// the user has decided.
absl::Status check_view_input(const Image& image, const std::string& path, const v1::Settings& settings,
                              const ViewChoice& view);

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
