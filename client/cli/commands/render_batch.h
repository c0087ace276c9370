// Renders many images, each for itself, into a folder.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/json_output.h"
#include "client/cli/render_report.h"
#include "client/cli/terminal.h"
#include "client/run/options.h"
#include "client/run/picture_run.h"
#include "client/run/sequence.h"

namespace candela {

// The files that these inputs name, each once, in the order of the inputs; those of a pattern or a folder are
// in natural order, without `output`, which an earlier run may have written there. A path without a pattern
// stays, even if nothing is there, and so does "-", which `only` cannot choose. It is as for find_frames().
// NOT_FOUND if a pattern or a folder has nothing, or nothing is left.
absl::StatusOr<FoundFiles> files_of_inputs(const std::vector<std::string>& inputs,
                                           const std::vector<std::string>& only,
                                           const std::string& output = "");

// Says what is left out, unless it is nothing.
void print_left_out(const LeftOut& left_out);

struct RenderPlan {
  std::vector<RenderJob> jobs;
  LeftOut left_out;
};

// The images that the options name, in the order of the inputs; those of a pattern or a folder are in natural
// order. A file that is named twice is rendered once. INVALID_ARGUMENT if two images would get one name,
// NOT_FOUND if a pattern matches nothing.
absl::StatusOr<RenderPlan> plan_render(const RenderOptions& options);

// Renders one image. Several threads call it at once.
using RenderOne = std::function<absl::StatusOr<RenderReport>(const RenderJob& job)>;

// Renders all of them, a few at once. Prints and writes the results in the order of the jobs, whatever
// finishes first. An image that fails is a line on stderr and does not stop the others; at the end the
// failure is "2 of 30 images failed", of the kind that all of them have. If there is an image, `last` is
// called after all of them. `broken` says why no image can be rendered at all, which ends everything; else
// OK.
//
// The JSON is one line an image, to_json() of its report or {input, output, error (text), code}, and a last
// line {summary {images, written, failed, seconds}}.
absl::Status render_batch(const RenderOptions& options, const std::vector<RenderJob>& jobs,
                          const RenderOne& render, const std::function<absl::Status()>& broken,
                          JsonOutput& json, Progress& progress,
                          const std::function<absl::Status()>& last = nullptr);

}  // namespace candela
