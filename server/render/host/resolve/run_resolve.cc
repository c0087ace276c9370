#include "server/render/host/resolve/run_resolve.h"

#include <algorithm>
#include <bit>

#include "absl/synchronization/mutex.h"
#include "server/base/check.h"
#include "server/render/host/bloom/run_bloom.h"
#include "server/render/host/resolve/resolve.h"

namespace candela::host {

namespace {

// A thread takes about this many bands of resolve in turn, so that all end at about the same time. A slice
// ends between two bands, so none has more texels than it makes in a few milliseconds.
constexpr uint32_t kBandsPerThread = 6;
constexpr uint32_t kMostTexelsOfBand = uint32_t{1} << 19;

struct Band {
  uint32_t first;
  uint32_t last;
};

// The rows of `groups`, which are rows of work groups, in bands for `threads` threads.
std::vector<Band> bands_of(const std::vector<Box>& groups, const shader::InputParams& frame,
                           uint32_t threads) {
  uint32_t rows = 0;
  for (const Box& box : groups) rows += box.y1 - box.y0;
  const uint32_t most = std::max<uint32_t>(1, kMostTexelsOfBand / (frame.width * kResolveGroupRows));
  const uint32_t step = std::clamp<uint32_t>(rows / (kBandsPerThread * threads), 1, most);
  std::vector<Band> bands;
  for (const Box& box : groups) {
    CHECK(box.y1 <= candela::groups(frame.height, kResolveGroupRows));
    for (uint32_t y = box.y0; y < box.y1; y += step) {
      bands.push_back(
          {y * kResolveGroupRows, std::min(std::min(y + step, box.y1) * kResolveGroupRows, frame.height)});
    }
  }
  return bands;
}

// Makes the rows of `groups`.
void run_groups(const ResolveJob& job, const std::vector<Box>& groups, Crew& crew, Drawn* drawn) {
  const std::vector<Band> bands = bands_of(groups, job.params.frame, crew.threads());
  absl::Mutex mutex;
  crew.run(static_cast<uint32_t>(bands.size()), [&](uint32_t i) {
    const ResolveFound found = resolve_rows(job, bands[i].first, bands[i].last);
    const absl::MutexLock lock(&mutex);
    drawn->gamut_cut_components += found.gamut_cut_components;
    drawn->negative_light = std::max(drawn->negative_light, std::bit_cast<float>(found.negative_light_bits));
    drawn->shown.largest = std::max<double>(drawn->shown.largest, std::bit_cast<float>(found.shown_max_bits));
    drawn->shown.mean += static_cast<double>(found.shown_sum) / shader::SHOWN_SCALE;  // a sum until the end
  });
}

Drawn run(const ResolveStep& step, const Tables& tables, const FrameTextures& textures, const Buffer& output,
          std::byte* tight_output, uint32_t format, Crew& crew) {
  ResolveJob job = {.constants = step.inputs.constants, .params = step.inputs.params, .opaque = step.opaque};
  job.constants.output_format = format;
  const bool resized = job.constants.pixels == shader::PIXELS_SCENE;
  job.wire = (resized ? textures.scene : textures.input).buffer().mapped();
  job.output = output.mapped();
  if (tight_output != nullptr) {
    job.output = tight_output;
    job.params.output_pitch = job.params.frame.width;
  }
  if (tables.colors != nullptr) {
    job.table = tables.colors->data()->data();
    job.table_points = static_cast<uint32_t>(tables.colors->size());
  }
  if (tables.gain != nullptr) {
    job.gain = tables.gain->data()->data();
    job.opaque = false;  // the map's codes are written where alpha would be
  }
  Drawn drawn;
  if (!step.bloom_groups.empty()) {
    job.level = level_planes(textures, 0);
    run_groups(job, step.bloom_groups, crew, &drawn);
  }
  // Bloom is exactly 0 there, so the shorter loop gives the same bits.
  job.constants.bloom = shader::BLOOM_NONE;
  run_groups(job, step.plain_groups, crew, &drawn);
  drawn.shown.mean /= double{1} * job.params.frame.width * job.params.frame.height;
  return drawn;
}

}  // namespace

Drawn run_resolve(const ResolveStep& step, const Tables& tables, const FrameTextures& textures,
                  std::byte* tight_output, Crew& crew) {
  return run(step, tables, textures, textures.output.buffer(), tight_output,
             static_cast<uint32_t>(textures.layout.output_format), crew);
}

void run_exact(const ResolveStep& step, const Tables& tables, const FrameTextures& textures, Crew& crew) {
  run(step, tables, textures, textures.exact.buffer(), nullptr, shader::OUTPUT_FLOAT, crew);
}

}  // namespace candela::host
