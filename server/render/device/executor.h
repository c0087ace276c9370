// The interface of everything that renders a plan. There is one executor for the Vulkan device and one for
// the float64 reference; the renderer chooses one for each frame.
#pragma once

#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/render/device/frame_memory.h"
#include "server/render/plan/plan.h"

namespace candela {

// One thread at a time. Both phases block until their work is complete. INVALID_ARGUMENT naming the pixel if
// the plan rejects bad values and there is one; UNAVAILABLE if the device is lost.
class Executor {
 public:
  virtual ~Executor() = default;

  // Phase A: meters the wire pixels in `memory`.
  virtual absl::StatusOr<Metered> meter(FrameMemory& memory, const IngestPlan& plan) = 0;
  // Phase B: makes the finished image, and the unquantised one if the memory was taken for verification. Adds
  // its times to *stages. Returns how many of the frame's R, G and B components the curve cut because they
  // lie outside its gamut.
  virtual absl::StatusOr<uint64_t> draw(FrameMemory& memory, const Plan& plan,
                                        std::vector<StageTime>* stages) = 0;
};

}  // namespace candela
