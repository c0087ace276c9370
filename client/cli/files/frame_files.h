// Between image files and frames on the wire.
#pragma once

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

// Of what a reader gives.
v1::PixelFormat wire_format(ImageFormat format);

// Refers to the image's pixels.
FrameView view_of(const Image& image);

// With the file's chromaticities, where the user named none.
v1::Settings settings_for(const Image& image, v1::Settings settings);

// A raw result as an image to write, with what its frame said of alpha and aspect.
absl::StatusOr<Image> picture_of(const RenderResult& result, bool has_alpha, double pixel_aspect);

// A server's refusal speaks of the frame; the user thinks of a file.
absl::Status name_file(const absl::Status& status, const std::string& path);

// A view of --ocio as the wire takes it.
struct BakedView {
  v1::ColorTable table;
  ViewReport report;
  std::vector<std::string> notes;
};
absl::StatusOr<BakedView> bake(const ViewChoice& choice);

}  // namespace candela
