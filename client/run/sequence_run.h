// Renders or meters a sequence: what it will read and write, and the run.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/run/events.h"
#include "client/run/exposure_file.h"
#include "client/run/frame_source.h"
#include "client/run/options.h"
#include "client/run/report.h"
#include "client/run/sequence.h"

namespace candela {

// What `candela stream` and `candela meter` of a sequence will read and write.

// An image of the sequence and its file.
struct NamedImage {
  int64_t number = 0;
  std::string input;  // of a missing frame: the file that is not there; "" if files have no common name
  std::string output;
};

struct StreamPlan {
  std::optional<OutputNames> names;  // absent: no images are made, or they go to standard output
  Sequence sequence;                 // from standard input it has no frame until they come
  std::vector<NamedImage> images;    // in order, with those of missing frames; none from standard input
  // The number of the first frame from standard input. They are counted from 1, as ffmpeg counts images, or
  // go on after the state of --state.
  int64_t first = 1;
};

// Finds the frames and names the images. Reads and writes no image. Refuses sequences in which two frames
// would become the same image, or an output would replace an input.
absl::StatusOr<StreamPlan> plan_stream(const StreamOptions& options, const ShotExposures& shot);

// The file of a frame's image; "" if there is none.
std::string output_of(const StreamOptions& options, const StreamPlan& plan, const FrameFacts& frame);

// The run of a sequence of files through a session: images, or metering alone.

// Renders the frames of the plan and writes its images. Frames from standard input join plan.sequence.
absl::StatusOr<RunSummary> render_sequence(const StreamOptions& options, const ShotExposures& shot,
                                           StreamPlan& plan, RunEvents& events);

}  // namespace candela
