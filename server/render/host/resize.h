// An image of another size on the host: the frame's light to a scene of the image's size, as docs/pipeline.md
// section 5 defines it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "server/base/crew.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/host/resolve.h"
#include "server/render/plan/plan.h"
#include "server/render/plan/resize_plan.h"

namespace candela::host {

// What an output of an axis is made of.
struct Taps {
  TexelRange texels;
  TexelRange main_lobe;
};

// What the pass reads and writes, all of it mapped. The block and the scene have four floats a texel. A
// register of the block holds the texel at one column of as many rows as it has room for.
struct ResizeJob {
  ResolveJob lit;                // reads the frame with its bloom, at an exposure of 1
  ResolveJob plain;              // the same without bloom
  std::vector<bool> lit_groups;  // for each kResolveGroupRows rows of the frame, whether bloom reaches them
  const AxisFilter* down = nullptr;
  const AxisFilter* across = nullptr;
  std::vector<Taps> down_taps;  // of each output
  std::vector<Taps> across_taps;
  TexelRange block_rows;   // rows of the image that the block holds
  float* block = nullptr;  // the frame's columns
  size_t block_pitch = 0;  // texels of a row, in whole registers
  float* scene = nullptr;  // the image's columns
  size_t scene_pitch = 0;  // texels from row to row
};

// Columns come in parts that begin at multiples of this, and rows of the block in parts that begin at
// multiples of the other.
inline constexpr uint32_t kResizeChunk = 256;
inline constexpr uint32_t kResizeRowStep = 4;
// resize_down() keeps the rows under a filter of at most this many taps, 4 KiB a chunk; beyond that it makes
// them for each output.
inline constexpr uint32_t kKeptRows = 128;

// The block's texels of these rows of the image and columns of the frame. Any thread; the bits do not depend
// on the parts. Needs instruction_set(), as what follows.
void resize_down(const ResizeJob& job, TexelRange rows, TexelRange columns);
// The scene's texels of these rows of the image, from the whole rows of the block.
void resize_across(const ResizeJob& job, TexelRange rows);

// Resizes the frame's light, as a plan has it, on a crew of threads.

// Makes the `scene` texture. Needs instruction_set().
void run_resize(const ResizeStep& step, const FrameTextures& textures, Crew& crew);

}  // namespace candela::host
