// The textures that a frame needs, and their sizes.
#pragma once

#include <cstdint>
#include <vector>

#include "server/render/plan/exposure.h"
#include "server/render/settings/settings.h"

namespace candela {

// The number of groups of `size` that hold `count`.
constexpr uint32_t groups(uint32_t count, uint32_t size) { return (count + size - 1) / size; }

struct LevelSize {
  uint32_t width;
  uint32_t height;
};

// Sizes of the bloom levels of a width x height frame: half its size, half of that and so on, at most
// `levels`. The first level always exists; a further one exists only if its short side has 2 texels or more.
// A `level_size` of 4 leaves out the first level, but keeps at least one.
std::vector<LevelSize> bloom_level_sizes(uint32_t width, uint32_t height, uint32_t levels,
                                         uint32_t level_size);

// Gaussian bloom has one quarter-size level, and a second one of that size for the result of its first pass.
std::vector<LevelSize> gaussian_level_sizes(uint32_t width, uint32_t height);

// Sizes are in texels.
struct TextureLayout {
  FrameDesc desc;
  v1::OutputFormat output_format = v1::OUTPUT_FORMAT_RGBA8;
  uint32_t pitch = 0;        // texels from row to row of the input: the width in whole groups
  ImageSize image;           // the output's size
  uint32_t image_pitch = 0;  // as `pitch`, of the output and the resized scene
  // The frame is resized in blocks of this many rows of the image, each filtered along y and then along x.
  // The first result is `resize_pitch` texels wide.
  uint32_t resize_rows = 0;  // 0: the image has the frame's size
  uint32_t resize_pitch = 0;
  uint32_t tiles_x = 0;
  uint32_t tiles_y = 0;
  uint32_t histogram_copies = 0;       // see shader::HISTOGRAM_TILES; 0 if no histogram is needed
  bool center_weights = false;         // ingest reads a table of weights
  std::vector<LevelSize> level_sizes;  // of the bloom; empty if the settings ask for none
  uint32_t level_size = kWholeBloom;   // texels of the frame to one of level 0, along a side
  bool by_reference = false;           // the float64 reference renders the frame, on the host
  bool may_need_reference = false;     // by_reference may be set when the frame is metered
  uint64_t reference_bytes = 0;        // what the reference allocates, to render or to verify

  bool first_level_twice = false;  // level 0 also stands for a finer level that was left out
  uint32_t summed_levels = 0;      // in the end, level 0 holds the sum of this many levels' light

  bool resizes() const { return resize_rows > 0; }

  // The part of the histogram that a read uses; with the scrub all of it.
  uint64_t histogram_bytes(bool scrub) const {
    return uint64_t{histogram_copies} * histogram_bins(scrub) * sizeof(shader::HistogramBin);
  }
};

// Pure. If max_error_codes has still to choose a tier, the layout is that of the costliest tier on the device
// that it may choose, and by_reference is set only if nothing else can keep it.
TextureLayout layout_textures(const FrameDesc& desc, const Settings& settings);

}  // namespace candela
