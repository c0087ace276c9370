// The interface of everything that renders a plan. There is one executor for the Vulkan device, one for
// the host's vector instructions and one for the float64 reference; the renderer chooses one for each frame.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/render/frame/frame_memory.h"
#include "server/render/plan/plan.h"

namespace candela {

// Facts about a frame that drawing finds. The first two are 0 for a frame without a negative component.
struct Drawn {
  // The frame's R, G and B components that the curve cut because they lie outside its gamut.
  uint64_t gamut_cut_components = 0;
  // The largest exposed light that a component of the scene has below 0, before bloom. Infinite if the curve
  // looks its light up on the axes AP1 and some of it is outside of AP1.
  float negative_light = 0.0f;
  ShownLight shown;
};

// One thread at a time. Both phases block until their work is complete. INVALID_ARGUMENT naming the pixel if
// the plan rejects bad values and there is one; UNAVAILABLE if the device is lost.
class Executor {
 public:
  virtual ~Executor() = default;

  // Phase A: meters the wire pixels in `memory`.
  absl::StatusOr<Metered> meter(FrameMemory& memory, const IngestPlan& plan);
  // Phase B: makes the finished image, and the unquantised one if the memory was allocated for verification.
  // Adds its times to *stages. A frame may be drawn again, by another plan.
  absl::StatusOr<Drawn> draw(FrameMemory& memory, const Plan& plan, std::vector<StageTime>* stages);

 private:
  // Whether run_meter() copies the rows of FrameTextures::client, if there are any; else meter() does before.
  virtual bool copies_rows() const { return false; }
  virtual absl::StatusOr<Metered> run_meter(FrameMemory& memory, const IngestPlan& plan) = 0;
  virtual absl::StatusOr<Drawn> run_draw(FrameMemory& memory, const Plan& plan,
                                         std::vector<StageTime>* stages) = 0;
};

}  // namespace candela
