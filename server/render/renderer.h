// Renders frames on one device: meters a frame, and draws it at the exposure that was decided.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/render/executor_kind.h"
#include "server/render/frame/frame_memory.h"
#include "server/render/frame/texture_pool.h"
#include "server/render/plan/exposure.h"
#include "server/render/plan/frame_stats.h"
#include "server/render/plan/plan.h"
#include "server/render/reference/verify.h"
#include "server/render/settings/settings.h"

namespace candela {

class EnvironmentBaker;
class Executor;
struct Drawn;

// Everything that is known about a rendered frame, except its image, which is in its FrameMemory.
struct FrameReport {
  FrameStats stats;
  double exposure = 0.0;  // the factor E that was used
  double target = 0.0;    // the factor that metering chose
  double target_before_limits = 0.0;
  uint64_t gamut_cut_components = 0;  // of R, G and B: negative in the curve's own primaries, and cut
  Plan plan;
  std::string tier;                   // that the frame was drawn with
  std::string tier_reason;            // if max_error_codes chose it, a line for people
  std::optional<double> error_bound;  // if max_error_codes chose the tier: the largest error in codes
  std::vector<StageTime> stages;
  std::optional<FrameVerification> verification;  // if the memory was taken for it
};

// A frame's place in a sequence.
struct FrameMoment {
  uint64_t sequence = 0;                     // the client's number; the dither depends on its low 32 bits
  std::optional<PreviousExposure> previous;  // absent: the frame takes its target at once
};

// One thread at a time, except allocate() and what EnvironmentBaker says.
class Renderer {
 public:
  // `device` and `pool` outlive the renderer. `threads` of the host make its passes; 0: usable_cpus().
  // FAILED_PRECONDITION, saying why, if the host is to make them and cannot.
  static absl::StatusOr<std::unique_ptr<Renderer>> create(Device& device, TexturePool& pool,
                                                          ExecutorKind passes = ExecutorKind::kAuto,
                                                          uint32_t threads = 0);
  ~Renderer();

  // Takes the memory for a frame. RESOURCE_EXHAUSTED if the pool's budget can never hold it, UNAVAILABLE if
  // the budget does not hold it beside the frames in flight. The settings' output format, metering, bloom and
  // tier and `verify` decide what is taken. Any thread; never waits.
  absl::StatusOr<FrameMemory> allocate(const FrameDesc& desc, const Settings& settings,
                                       Verify verify = Verify::kNo);

  // The part of the pool's budget that allocate() takes. Fails with RESOURCE_EXHAUSTED as it does. Any
  // thread.
  absl::StatusOr<uint64_t> bytes_for(const FrameDesc& desc, const Settings& settings,
                                     Verify verify = Verify::kNo) const;

  // Renders the pixels in `memory` to completion: meter(), expose() and draw(). `settings` must be
  // those that the memory was allocated with. INVALID_ARGUMENT naming the pixel if
  // v1::BAD_VALUES_REJECT meets a bad one; UNAVAILABLE if the device is lost. Blocks for the frame's time,
  // which with verification is seconds for a large frame.
  absl::StatusOr<FrameReport> render(FrameMemory& memory, const Settings& settings,
                                     const FrameMoment& moment = {});

  // Who makes the passes, kDevice or kHost, and the same in words: "on the host, AVX2, 2 threads".
  ExecutorKind executor_kind() const { return executor_kind_; }
  const std::string& executor_words() const { return executor_words_; }

  // Bakes environments on this device. Their views are made as the passes are.
  EnvironmentBaker& baker() const { return *baker_; }

  // The two halves of render(). The caller decides the exposure between them, and may meter or draw other
  // frames before it calls draw(), once. If max_error_codes has to choose the tier, draw() does; the device
  // has metered the frame, unless only the reference can keep it. FAILED_PRECONDITION if no tier within
  // max_ms keeps it.
  absl::StatusOr<Metered> meter(FrameMemory& memory, const Settings& settings);
  absl::StatusOr<FrameReport> draw(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                   const Metered& metered, const Exposed& exposed);

 private:
  Renderer(Device& device, TexturePool& pool);
  // Sets passes_ and what follows from it.
  absl::Status choose(ExecutorKind passes, uint32_t threads);
  Executor& executor_of(const FrameMemory& memory) const;
  // Makes the image in the memory's layout, and fills in the report except what verification finds.
  absl::StatusOr<Drawn> draw_image(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                   const Metered& metered, FrameReport& report);
  // The same with the cheapest tier that keeps max_error_codes, in its own layout.
  absl::Status draw_within_error(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                 const Metered& metered, FrameReport& report);

  Device& device_;
  TexturePool& pool_;
  ExecutorKind executor_kind_ = ExecutorKind::kDevice;
  std::string executor_words_;
  std::unique_ptr<Executor> by_device_or_host_;
  std::unique_ptr<Executor> by_reference_;
  std::unique_ptr<EnvironmentBaker> baker_;  // may use the threads of by_device_or_host_
};

}  // namespace candela
