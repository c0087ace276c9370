// Where the images of a run go.
#pragma once

#include "absl/status/status.h"
#include "client/render_result.h"
#include "client/run/report.h"

namespace candela {

// Gets every frame of a run once, in order. Used by one thread.
class FrameSink {
 public:
  virtual ~FrameSink() = default;

  // The frame's image. If it cannot be written, this call or a later one fails.
  virtual absl::Status image(RunFrame frame, RenderResult image) = 0;

  // The frame has no image of its own. If frame.held is set, the image before it, which must exist, is
  // repeated with the same bytes. Otherwise frame.status says why there is none.
  virtual absl::Status none(RunFrame frame) = 0;

  // Waits until all images are where they belong.
  virtual absl::Status finish() = 0;
};

}  // namespace candela
