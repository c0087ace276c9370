// The frames of `candela view` with a moving camera, through a session.
#pragma once

#include "absl/status/statusor.h"
#include "client/cli/commands/stream/stream_report.h"
#include "client/cli/environment/view_scene.h"
#include "client/cli/files/json_output.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/options.h"

namespace candela {

// Renders and writes all frames of the scene.
absl::StatusOr<StreamSummary> render_view_sequence(const PanoramaViewOptions& options, const ViewScene& scene,
                                                   JsonOutput& json, Progress& progress);

}  // namespace candela
