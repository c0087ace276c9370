// What will run for a frame, decided between its two phases.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/render/plan/metering.h"
#include "server/render/settings/settings.h"
#include "server/render/settings/tiers.h"
#include "server/vulkan/box.h"

namespace candela {

// What phase A found out, over the whole frame. Luminance is scene-linear Rec.709 Y after the scrub.
struct FrameStats {
  double mean_log2_luminance = 0.0;  // EV
  float min_luminance = 0.0f;
  float max_luminance = 0.0f;
  uint64_t nan_components = 0;
  uint64_t infinite_components = 0;
  uint64_t negative_components = 0;
  uint64_t metered_weight = 0;  // the sum of all texels' metering weights
  // Of every tile of shader::TILE_TEXELS squared, row by row, the largest luminance with negative components
  // cut to 0: no mean of its texels, as bloom makes them, is brighter. Empty where no bloom was asked for.
  std::vector<float> tile_light;
  ScenePrint print{};
  // By log2 luminance, 64 bins an octave from 2^-14 on, where the settings ask for it.
  std::vector<uint64_t> histogram;
};

// Scene luminance above which there is bloom: the settings' own, or kGaussian's multiple of the mean.
float bright_threshold(const BloomSettings& bloom, const FrameStats& stats);

// Sizes of the bloom levels of a width x height frame: half its size, half of that and so on, `levels` of
// them at most. The first always exists, a further one only when its short side has 2 texels or more.
// `level_size` 4 leaves the first one out, and makes one all the same.
struct LevelSize {
  uint32_t width;
  uint32_t height;
};
std::vector<LevelSize> bloom_level_sizes(uint32_t width, uint32_t height, uint32_t levels,
                                         uint32_t level_size);
// kGaussian works on one quarter-size level, and on a second one of that size in between.
std::vector<LevelSize> gaussian_level_sizes(uint32_t width, uint32_t height);

enum class Pass : uint32_t { kIngest, kBrightPass, kBloomDown, kBloomUp, kGaussian, kResolve, kReference };
// "ingest", "bright_pass", "bloom_down", "bloom_up", "gaussian", "resolve", "reference"
const char* name(Pass pass);

// One texture made; kReference is the host's work and stands for all that follows ingest.
// `level` is the level written: for kBrightPass 0, for kBloomDown n+1, for kBloomUp n, for kGaussian 1 in the
// vertical pass and 0 in the horizontal one.
struct Step {
  Pass pass;
  uint32_t level = 0;
  bool operator==(const Step&) const = default;
};

struct Plan {
  std::vector<Step> steps;  // in order; kIngest comes first
  bool bloom = false;       // resolve adds bloom
  std::vector<Box> lit;     // where the frame may pass the bright pass, in texels; it does not elsewhere
  std::vector<std::string> words;  // the same for people, with the reasons
};

// Pure: the same arguments give the same plan. `scrubbed`: the frame had to be read again with the scrub.
Plan plan_frame(const FrameDesc& desc, const FrameStats& stats, bool scrubbed, const Settings& settings,
                const Tier& tier);

}  // namespace candela
