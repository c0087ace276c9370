// The run of one image file: read, rendered by one call, and written.
#pragma once

#include <functional>
#include <string>

#include "absl/status/statusor.h"
#include "client/image/image.h"
#include "client/run/events.h"
#include "client/run/options.h"
#include "client/run/report.h"
#include "client/run/run.h"

namespace candela {

// One image to render: a file in, a file out.
struct RenderJob {
  std::string input;
  std::string output;
  std::function<void(Image)> take = nullptr;  // gets the image in place of a file
};

// Reads the input, has the server render it, and writes the output. Several threads may call it with one
// `run`. `only` says that no other image follows: the server is stopped before the image is written.
absl::StatusOr<RenderReport> run_frame(const RenderOptions& options, const RenderJob& job, bool only,
                                       Run& run, RunEvents& events);

}  // namespace candela
