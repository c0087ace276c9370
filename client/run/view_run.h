// The runs of `candela view`: one picture of a panorama, or a sequence with a moving camera.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/run/events.h"
#include "client/run/options.h"
#include "client/run/report.h"
#include "client/run/view_scene.h"

namespace candela {

// Renders one view and writes it.
absl::StatusOr<RenderReport> render_view(const PanoramaViewOptions& options, const ViewScene& scene,
                                         RunEvents& events);

// Renders all frames of the scene and writes them to `outputs`, a file for each.
absl::StatusOr<RunSummary> render_views(const PanoramaViewOptions& options, const ViewScene& scene,
                                        std::vector<std::string> outputs, RunEvents& events);

}  // namespace candela
