// What a server needs of whoever makes its frames: their memory, and the two phases of each.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/render/frame/frame_memory.h"
#include "server/render/plan/exposure.h"
#include "server/render/plan/frame_stats.h"
#include "server/render/plan/plan.h"
#include "server/render/reference/verify.h"
#include "server/render/settings/settings.h"

namespace candela {

class EnvironmentBaker;
struct BakeQuality;
struct Environment;
struct View;

// Everything that is known about a rendered frame, except its image, which is in its FrameMemory.
struct FrameReport {
  FrameStats stats;
  double exposure = 0.0;  // the factor E that was used
  double target = 0.0;    // the factor that metering chose
  double target_before_limits = 0.0;
  uint64_t gamut_cut_components = 0;  // of R, G and B: negative in the curve's own primaries, and cut
  std::optional<ShownLight> shown;    // of an image in PQ or HLG
  Plan plan;
  std::string tier;                   // that the frame was drawn with
  std::string tier_reason;            // if max_error_codes chose it, a line for people
  std::optional<double> error_bound;  // if max_error_codes chose the tier: the largest error in codes
  std::vector<StageTime> stages;
  std::optional<FrameVerification> verification;  // if the memory was allocated for it
};

// What a report says before the frame is drawn. The exposure has to be finite and above 0.
FrameReport report_of(const Metered& metered, const Exposed& exposed);

// A frame's place in a sequence.
struct FrameMoment {
  uint64_t sequence = 0;                     // the client's number; the dither depends on its low 32 bits
  std::optional<PreviousExposure> previous;  // absent: the frame takes its target at once
};

// Renderer makes frames; the simulator's only computes with their bytes
// (tests/support/simulated/frame_maker.h). One thread at a time, except allocate(), bytes_for() and what
// EnvironmentBaker says.
class FrameMaker {
 public:
  virtual ~FrameMaker() = default;

  // Takes the memory for a frame. RESOURCE_EXHAUSTED if the pool's budget can never hold it, UNAVAILABLE if
  // the budget does not hold it beside the frames in flight. Its size depends on `desc`, on the settings'
  // output format, metering, bloom and tier, and on `verify`. Any thread; never waits.
  virtual absl::StatusOr<FrameMemory> allocate(const FrameDesc& desc, const Settings& settings,
                                               Verify verify = Verify::kNo) = 0;

  // The part of the pool's budget that allocate() takes. Fails with RESOURCE_EXHAUSTED as it does. Any
  // thread.
  virtual absl::StatusOr<uint64_t> bytes_for(const FrameDesc& desc, const Settings& settings,
                                             Verify verify = Verify::kNo) const = 0;

  // Renders the pixels in `memory` to completion: meter(), expose() and draw(). `settings` must be
  // those that the memory was allocated with. INVALID_ARGUMENT naming the pixel if
  // v1::BAD_VALUES_REJECT meets a bad one; UNAVAILABLE if the device is lost. Blocks for the frame's time,
  // which with verification is seconds for a large frame.
  absl::StatusOr<FrameReport> render(FrameMemory& memory, const Settings& settings,
                                     const FrameMoment& moment = {});

  // The two halves of render(). The caller decides the exposure between them, and may meter or draw other
  // frames before it calls draw(), once. If the settings have max_error_codes, draw() chooses the tier.
  // meter() has then used the device, unless only the tier `reference` can keep that bound.
  virtual absl::StatusOr<Metered> meter(FrameMemory& memory, const Settings& settings) = 0;
  virtual absl::StatusOr<FrameReport> draw(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                           const Metered& metered, const Exposed& exposed) = 0;

  // Make what an environment's views read, and one of them in place of the wire's pixels. As
  // EnvironmentBaker does.
  virtual absl::Status prepare_view(Environment& environment, const BakeQuality& quality, bool objects) = 0;
  virtual absl::Status render_view(Environment& environment, const View& view, FrameMemory& memory) = 0;

  // FAILED_PRECONDITION, saying what to do, if nothing here bakes environments. Then there are none, and no
  // function of theirs may be called. Any thread.
  virtual absl::Status check_environments() const = 0;
  // Bakes environments, whose views are frames that this maker makes.
  virtual EnvironmentBaker& baker() const = 0;
};

}  // namespace candela
