#include "server/render/host/resize/run_resize.h"

#include <algorithm>
#include <cstddef>

#include "server/render/host/bloom/run_bloom.h"
#include "server/render/host/resize/resize.h"

namespace candela::host {

namespace {

// What a thread keeps of the frame's rows while it adds them up.
constexpr uint64_t kKeptBytes = 1 << 20;
// A slice ends between two units of work, so none has more texels of the frame than this; units for each
// thread, so that all end at about the same time; and rows of the image that are worth making the rows around
// them twice.
constexpr uint64_t kMostTexelsOfUnit = uint64_t{1} << 20;
constexpr uint32_t kUnitsPerThread = 3;
constexpr uint32_t kLeastRows = 16;

// The work of resize_down() on a block.
struct Units {
  uint32_t columns;  // of a unit
  uint32_t across;   // units side by side
  uint32_t rows;     // of a unit
  uint32_t down;     // units one below the other
};

Units units_of(const AxisFilter& down, uint32_t width, uint32_t rows, uint32_t threads) {
  const uint32_t chunks = groups(width, kResizeChunk);
  const uint64_t kept_rows = down.mean > 0 || down.taps > kKeptRows ? 3 : down.taps;
  const uint64_t frame_rows = uint64_t{rows} * down.from / down.to + down.taps;
  // Rows are read whole if they can be: processors fetch what follows.
  const uint64_t most =
      std::min<uint64_t>(kKeptBytes / (kept_rows * 4 * sizeof(float) * kResizeChunk), chunks);
  uint64_t columns = std::max<uint64_t>(1, most) * kResizeChunk;
  const uint64_t wanted = std::max<uint64_t>(kUnitsPerThread * threads * columns / width,
                                             frame_rows * columns / kMostTexelsOfUnit);
  const uint64_t least = down.mean > 0 ? 1 : kLeastRows;
  Units units{};
  units.rows =
      static_cast<uint32_t>(std::min<uint64_t>(rows, std::max(least, rows / std::max<uint64_t>(1, wanted))));
  units.rows = groups(units.rows, kResizeRowStep) * kResizeRowStep;
  units.down = groups(rows, units.rows);
  // Rows of the image that many of the frame's make have fewer columns.
  const uint64_t rows_of_unit = uint64_t{std::min(units.rows, rows)} * down.from / down.to + down.taps;
  const uint64_t fit = kMostTexelsOfUnit / rows_of_unit / kResizeChunk;
  columns = std::min(columns, std::max<uint64_t>(1, fit) * kResizeChunk);
  units.columns = static_cast<uint32_t>(columns);
  units.across = groups(width, units.columns);
  return units;
}

std::vector<Taps> taps_of(const AxisFilter& filter) {
  std::vector<Taps> taps;
  taps.reserve(filter.to);
  for (uint32_t i = 0; i < filter.to; ++i) taps.push_back({filter.texels(i), filter.main_lobe(i)});
  return taps;
}

ResizeJob job_of(const ResizeStep& step, const FrameTextures& textures) {
  const ResolveStep& frame = step.frame;
  ResizeJob job;
  job.lit = {.constants = frame.inputs.constants, .params = frame.inputs.params, .opaque = frame.opaque};
  job.lit.wire = textures.input.buffer().mapped();
  job.plain = job.lit;
  job.plain.constants.bloom = shader::BLOOM_NONE;
  job.lit_groups.resize(groups(frame.inputs.params.frame.height, kResolveGroupRows));
  for (const Box& box : frame.bloom_groups) {
    std::fill(job.lit_groups.begin() + box.y0, job.lit_groups.begin() + box.y1, true);
  }
  if (frame.bloom_groups.empty()) {
    job.lit.constants.bloom = shader::BLOOM_NONE;
  } else {
    job.lit.level = level_planes(textures, 0);
  }
  job.down = &step.down;
  job.across = &step.across;
  job.down_taps = taps_of(step.down);
  job.across_taps = taps_of(step.across);
  job.block = reinterpret_cast<float*>(textures.resize_block.buffer().mapped());
  job.block_pitch = textures.layout.resize_pitch;
  job.scene = reinterpret_cast<float*>(textures.scene.buffer().mapped());
  job.scene_pitch = textures.layout.image_pitch;
  return job;
}

}  // namespace

void run_resize(const ResizeStep& step, const FrameTextures& textures, Crew& crew) {
  ResizeJob job = job_of(step, textures);
  const uint32_t width = step.across.from;
  const uint32_t height = step.down.to;
  const uint32_t block_rows = textures.layout.resize_rows;
  for (uint32_t first = 0; first < height; first += block_rows) {
    const uint32_t last = std::min(first + block_rows, height);
    job.block_rows = {first, last};
    const Units units = units_of(step.down, width, last - first, crew.threads());
    crew.run(units.across * units.down, [&](uint32_t i) {
      const uint32_t x = i % units.across * units.columns;
      const uint32_t y = first + i / units.across * units.rows;
      resize_down(job, {y, std::min(y + units.rows, last)}, {x, std::min(x + units.columns, width)});
    });
    const uint32_t rows =
        groups(last - first, kUnitsPerThread * kResizeRowStep * crew.threads()) * kResizeRowStep;
    crew.run(groups(last - first, rows), [&](uint32_t i) {
      const uint32_t y = first + i * rows;
      resize_across(job, {y, std::min(y + rows, last)});
    });
  }
}

}  // namespace candela::host
