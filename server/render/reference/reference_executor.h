// Renders plans in float64 on the host, from a scene that is not rounded to halves: seconds for a large
// frame.
#pragma once

#include "server/render/frame/executor.h"

namespace candela {

// The stage that its times count as.
inline constexpr char kReferenceStage[] = "reference";

// Uses every core.
class ReferenceExecutor final : public Executor {
 public:
  // `device` meters everything but the mean luminance, and outlives this.
  explicit ReferenceExecutor(Executor& device) : device_(device) {}

 private:
  // The mean log2 luminance is the reference's own; the other statistics are the device's.
  absl::StatusOr<Metered> run_meter(FrameMemory& memory, const IngestPlan& plan) override;
  absl::StatusOr<Drawn> run_draw(FrameMemory& memory, const Plan& plan,
                                 std::vector<StageTime>* stages) override;
  Executor& device_;
};

}  // namespace candela
