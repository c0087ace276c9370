// The passes of a frame, recorded: which pipeline, which parameters, how many groups. Internal to
// server/render.
#pragma once

#include <span>

#include "absl/status/status.h"
#include "server/render/device/frame_memory.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"
#include "shaders/params.h"

namespace candela {

// What the passes of one frame need to know. References live for the frame.
struct PassContext {
  const FrameMemory::Parts& parts;
  const Settings& settings;
  const Tier& tier;
  shader::InputParams input;     // of the frame; carries the primaries' matrix
  bool matrix = false;           // the matrix is not the identity
  bool scrub = false;            // some component is not finite or beyond +-65504
  bool bloom = false;            // resolve: there is some
  std::span<const Box> lit{};    // of the bloom's passes: where the frame has light for it, in texels
  float bright_threshold = 0.0;  // bright pass: scene luminance
  double exposure = 1.0;         // resolve: E * prescale
  uint32_t dither_frame = 0;     // resolve: the frame's sequence number, low 32 bits
  // resolve, of the curves that have one: the table, and its points on the device.
  const ColorTable* table = nullptr;
  const Buffer* table_points = nullptr;
};

PassContext pass_context(const FrameMemory::Parts& parts, const Settings& settings);

// How many levels' light the bloom texture holds the sum of.
uint32_t summed_levels(const PassContext& context);

// Records one step. Barriers between steps are the caller's.
absl::Status record(const Step& step, const PassContext& context, PipelineCache& pipelines,
                    Recorder& recorder);

// Records resolve once more, unquantised, into the memory's `exact` texture.
absl::Status record_exact(const PassContext& context, PipelineCache& pipelines, Recorder& recorder);

}  // namespace candela
