// What was measured of a frame: its statistics, what metering found, and the time of each stage.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <vector>

#include "server/render/plan/exposure.h"

namespace candela {

struct StageTime {
  const char* name;  // a pass's name, see plan.h, or "upload", "download", "reference", "verify"
  uint64_t ns;       // device time; host time for "reference" and "verify"
};

// Adds the time to the stage of the same name, or appends a new stage.
void add_time(const StageTime& time, std::vector<StageTime>* stages);

// Adds to the stage the host time from construction to destruction, without pauses between slices.
class HostStage {
 public:
  // `name` and `stages` outlive it.
  HostStage(const char* name, std::vector<StageTime>* stages);
  HostStage(const HostStage&) = delete;
  HostStage& operator=(const HostStage&) = delete;
  ~HostStage();

 private:
  const char* name_;
  std::vector<StageTime>* stages_;
  const std::chrono::steady_clock::time_point begin_;
  const std::chrono::nanoseconds paused_before_;
};

// The statistics of a frame, and the result of metering it.

// Statistics of the whole frame. Luminance is scene-linear Rec.709 Y after the scrub.
struct FrameStats {
  double mean_log2_luminance = 0.0;  // EV; kNothingMetered if metered_weight is 0
  float min_luminance = 0.0f;
  float max_luminance = 0.0f;
  uint64_t nan_components = 0;
  uint64_t infinite_components = 0;
  uint64_t clamped_components = 0;  // finite and beyond +-2^30, on the wire or after the matrix
  uint64_t negative_components = 0;
  uint64_t negative_scene_components = 0;  // in Rec.709; without a matrix the same as on the wire
  uint64_t absent_pixels = 0;              // see docs/pipeline.md section 1; 0 if they are metered
  // The sum of all texels' metering weights; 0 if nothing is metered. If some alpha is neither 0 nor 1, a
  // weight of 1 counts as 255, except with CENTER.
  uint64_t metered_weight = 0;
  // The largest luminance of each tile of shader::TILE_TEXELS squared, row by row, with negative components
  // cut to 0. No mean that bloom makes of the tile's texels is brighter. Empty if the settings ask for no
  // bloom.
  std::vector<float> tile_light;
  ScenePrint print{};
  // Weights by log2 luminance, 64 bins an octave from 2^-14 on: 30 octaves, or 45 if there is light in the
  // higher ones. Empty unless the settings ask for it.
  std::vector<uint64_t> histogram;

  // The mean from which exposure follows; absent if nothing is metered.
  std::optional<double> metered_mean() const {
    return metered_weight > 0 ? std::optional(mean_log2_luminance) : std::nullopt;
  }
};

// The result of phase A. If the float64 reference meters, the mean log2 luminance, the smallest and the
// largest luminance and the metered weight are the reference's, of the scene that it does not round; the
// other statistics are those of the device's or the host's passes.
struct Metered {
  FrameStats stats;
  bool scrubbed = false;   // the frame was read once more, with the scrub
  bool alpha = false;      // some alpha is not 1
  bool uncovered = false;  // no alpha is above 0, and something is not absent
  std::vector<StageTime> stages{};
};

}  // namespace candela
