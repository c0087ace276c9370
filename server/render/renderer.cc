#include "server/render/renderer.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/render/color/aces.h"
#include "server/render/device/frame_memory.h"
#include "server/render/device/passes.h"
#include "server/render/device/table_cache.h"
#include "server/render/plan/metering.h"
#include "server/render/reference/verify.h"
#include "server/vulkan/pipeline.h"
#include "server/vulkan/recorder.h"

namespace candela {

namespace {

// Each takes 2 to 3 MB on the software device; clients choose the settings that they are made for.
constexpr size_t kMaxPipelines = 64;

// What the tiles add up to, before it is turned into statistics.
struct TileSums {
  FrameStats stats;
  bool needs_scrub = false;               // some component on the wire is not finite or beyond +-65504
  uint32_t first_bad_texel = UINT32_MAX;  // y * width + x; UINT32_MAX: none
};

constexpr double kFixedPointPerEv = 1u << shader::LOG2_FRACTION_BITS;

std::vector<MeterBin> bins_of(const FrameMemory::Parts& parts, const MeteringSettings& metering) {
  const double offset_ev = (metering.weights == MeterWeights::kCenter ? 256.0 : 1.0) / kFixedPointPerEv;
  std::vector<MeterBin> bins(shader::HISTOGRAM_BINS);
  for (size_t i = 0; i < size_t{parts.histogram_copies} * shader::HISTOGRAM_BINS; ++i) {
    shader::HistogramBin bin;
    std::memcpy(&bin, parts.host_histogram().mapped() + i * sizeof bin, sizeof bin);
    bins[i % shader::HISTOGRAM_BINS].weight += bin.weight;
    bins[i % shader::HISTOGRAM_BINS].above_ev += bin.offset_sum * offset_ev;
  }
  return bins;
}

shader::TileRecord tile_at(const FrameMemory::Parts& parts, uint32_t x, uint32_t y) {
  shader::TileRecord tile;
  std::memcpy(&tile, parts.host_tiles().mapped() + (size_t{y} * parts.tiles_x + x) * sizeof tile,
              sizeof tile);
  return tile;
}

uint64_t fixed_log2_of(const shader::TileRecord& tile) {
  return tile.log2_sum_low + (uint64_t{tile.log2_sum_high} << 16);
}

double log2_of(uint64_t fixed_log2, uint64_t weight) {
  return static_cast<double>(fixed_log2) / (kFixedPointPerEv * static_cast<double>(weight)) -
         shader::LOG2_BIAS;
}

// Of the tiles of a cell, at least one each way.
ScenePrint print_of(const FrameMemory::Parts& parts, bool weighted) {
  constexpr uint32_t kCells = 8;
  ScenePrint print;
  const auto first = [](uint32_t cell, uint32_t tiles) { return cell * tiles / kCells; };
  const auto last = [&](uint32_t cell, uint32_t tiles) {
    return std::max(first(cell, tiles) + 1, first(cell + 1, tiles));
  };
  const auto texels = [](uint32_t tile, uint32_t size) {
    return std::min(shader::TILE_TEXELS, size - tile * shader::TILE_TEXELS);
  };
  for (uint32_t cell = 0; cell < print.size(); ++cell) {
    uint64_t fixed_log2 = 0;
    uint64_t weight = 0;
    for (uint32_t y = first(cell / kCells, parts.tiles_y); y < last(cell / kCells, parts.tiles_y); ++y) {
      for (uint32_t x = first(cell % kCells, parts.tiles_x); x < last(cell % kCells, parts.tiles_x); ++x) {
        const shader::TileRecord tile = tile_at(parts, x, y);
        fixed_log2 += fixed_log2_of(tile);
        weight +=
            weighted ? tile.weight_sum : uint64_t{texels(x, parts.desc.width)} * texels(y, parts.desc.height);
      }
    }
    print[cell] = weight == 0 ? NAN : static_cast<float>(log2_of(fixed_log2, weight));
  }
  return print;
}

TileSums sum_tiles(const FrameMemory::Parts& parts, const Settings& settings) {
  TileSums sums;
  FrameStats& stats = sums.stats;
  // At 16384 x 16384: 2^28 texels of 25 bits, and with weights of 8 bits, 2^61 at most.
  uint64_t fixed_log2 = 0;
  uint32_t darkest_inverted = 0;
  uint32_t brightest = 0;
  uint32_t magnitude = 0;
  uint64_t weight = 0;
  const size_t count = size_t{parts.tiles_x} * parts.tiles_y;
  for (size_t i = 0; i < count; ++i) {
    const shader::TileRecord tile =
        tile_at(parts, static_cast<uint32_t>(i % parts.tiles_x), static_cast<uint32_t>(i / parts.tiles_x));
    fixed_log2 += fixed_log2_of(tile);
    brightest = std::max(brightest, tile.max_luminance_bits);
    darkest_inverted = std::max(darkest_inverted, tile.min_luminance_bits_inverted);
    magnitude = std::max(magnitude, tile.max_magnitude_bits);
    stats.nan_components += tile.nan_components;
    stats.infinite_components += tile.infinite_components;
    stats.negative_components += tile.negative_components;
    weight += tile.weight_sum;
    if (!parts.levels.empty()) stats.tile_light.push_back(std::bit_cast<float>(tile.max_light_bits));
    sums.first_bad_texel = std::min(sums.first_bad_texel, ~tile.first_bad_texel_inverted);
  }
  const MeteringSettings& metering = settings.exposure.metering;
  const bool weighted = metering.weights != MeterWeights::kAverage;
  stats.metered_weight = weighted ? weight : uint64_t{parts.desc.width} * parts.desc.height;
  stats.mean_log2_luminance = log2_of(fixed_log2, stats.metered_weight);
  if (parts.histogram_copies > 0) {
    const std::vector<MeterBin> bins = bins_of(parts, metering);
    if (metering.statistic == MeterStatistic::kPercentile) {
      stats.mean_log2_luminance = percentile_mean(bins, metering.percentile_low, metering.percentile_high);
    }
    if (metering.histogram) {
      for (const MeterBin& bin : bins) stats.histogram.push_back(bin.weight);
    }
  }
  stats.print = print_of(parts, weighted);
  stats.max_luminance = std::bit_cast<float>(brightest);
  stats.min_luminance = std::bit_cast<float>(~darkest_inverted);
  sums.needs_scrub = magnitude > std::bit_cast<uint32_t>(shader::MAX_SCENE_VALUE);
  return sums;
}

constexpr char kVerify[] = "verify";

void add_time(const StageTime& time, std::vector<StageTime>* stages) {
  const auto same = std::find_if(stages->begin(), stages->end(), [&](const StageTime& stage) {
    return std::strcmp(stage.name, time.name) == 0;
  });
  if (same == stages->end()) {
    stages->push_back(time);
  } else {
    same->ns += time.ns;
  }
}

void add_timings(const Recorder& recorder, std::vector<StageTime>* stages) {
  for (const Recorder::Timing& timing : recorder.timings()) add_time({timing.name, timing.ns}, stages);
}

void add_host_time(const char* stage, std::vector<StageTime>* stages, const std::function<void()>& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  const std::chrono::nanoseconds took = std::chrono::steady_clock::now() - begin;
  add_time({stage, static_cast<uint64_t>(took.count())}, stages);
}

}  // namespace

struct Renderer::Impl {
  Device& device;
  TexturePool& pool;
  PipelineCache pipelines;
  Recorder recorder;
  TableCache tables;

  // Phase A: everything that one read of the frame can tell. Adds its times to *stages.
  absl::StatusOr<TileSums> measure(const PassContext& context, bool upload, std::vector<StageTime>* stages);
  // The table of curves that have one.
  absl::Status load_table(PassContext& context);
  // Phase B: what the plan says.
  absl::Status draw(const PassContext& context, const Plan& plan);
};

absl::StatusOr<TileSums> Renderer::Impl::measure(const PassContext& context, bool upload,
                                                 std::vector<StageTime>* stages) {
  const FrameMemory::Parts& parts = context.parts;
  if (absl::Status status = recorder.begin(); !status.ok()) return status;
  if (upload && parts.upload) {
    recorder.mark("upload");
    recorder.copy(parts.upload.buffer(), parts.input.buffer(), parts.input.buffer().bytes());
  }
  recorder.mark(name(Pass::kIngest));
  recorder.fill_zero(parts.tiles.buffer());
  if (parts.histogram) recorder.fill_zero(parts.histogram.buffer());
  if (parts.center_weights) {
    const std::vector<uint32_t> weights = center_weights();
    recorder.update(parts.center_weights.buffer(), weights.data(), weights.size() * sizeof weights[0]);
  }
  recorder.barrier();
  if (absl::Status status = record({Pass::kIngest}, context, pipelines, recorder); !status.ok())
    return status;
  if (parts.tiles_readback) {
    recorder.barrier();
    recorder.copy(parts.tiles.buffer(), parts.tiles_readback.buffer(), parts.tiles.buffer().bytes());
    if (parts.histogram_readback) {
      recorder.copy(parts.histogram.buffer(), parts.histogram_readback.buffer(),
                    parts.histogram.buffer().bytes());
    }
  }
  recorder.barrier_to_host();
  if (absl::Status status = recorder.submit_and_wait(); !status.ok()) return status;
  add_timings(recorder, stages);
  return sum_tiles(parts, context.settings);
}

absl::Status Renderer::Impl::load_table(PassContext& context) {
  std::shared_ptr<const ColorTable> table = context.settings.table;
  if (context.settings.curve == ToneCurve::kAces1) {
    absl::StatusOr<std::shared_ptr<const ColorTable>> baked = aces_1_table(context.tier.table_size);
    if (!baked.ok()) return baked.status();
    table = *std::move(baked);
  }
  if (!table) return absl::OkStatus();
  const absl::StatusOr<const Buffer*> points = tables.get(table, recorder);
  if (!points.ok()) return points.status();
  context.table = table.get();
  context.table_points = *points;
  return absl::OkStatus();
}

absl::Status Renderer::Impl::draw(const PassContext& context, const Plan& plan) {
  const FrameMemory::Parts& parts = context.parts;
  if (absl::Status status = recorder.begin(); !status.ok()) return status;
  for (const Step& step : plan.steps) {
    if (step.pass == Pass::kIngest) continue;
    recorder.mark(name(step.pass));
    if (absl::Status status = record(step, context, pipelines, recorder); !status.ok()) return status;
    recorder.barrier();
  }
  if (parts.readback) {
    recorder.mark("download");
    recorder.copy(parts.output.buffer(), parts.readback.buffer(), parts.output.buffer().bytes());
  }
  if (parts.exact) {
    recorder.mark(kVerify);
    if (absl::Status status = record_exact(context, pipelines, recorder); !status.ok()) return status;
    recorder.barrier();
    const auto read_back = [this](const TexturePool::Lease& from, const TexturePool::Lease& to) {
      if (to) recorder.copy(from.buffer(), to.buffer(), to.buffer().bytes());
    };
    read_back(parts.exact, parts.exact_readback);
    if (plan.bloom) read_back(parts.levels[0], parts.level_readback);
  }
  recorder.barrier_to_host();
  return recorder.submit_and_wait();
}

Renderer::Renderer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Renderer::~Renderer() = default;

absl::StatusOr<std::unique_ptr<Renderer>> Renderer::create(Device& device, TexturePool& pool) {
  absl::StatusOr<PipelineCache> pipelines = PipelineCache::create(device);
  if (!pipelines.ok()) return pipelines.status();
  absl::StatusOr<Recorder> recorder = Recorder::create(device);
  if (!recorder.ok()) return recorder.status();
  return std::unique_ptr<Renderer>(new Renderer(std::unique_ptr<Impl>(
      new Impl{device, pool, *std::move(pipelines), *std::move(recorder), TableCache(device)})));
}

absl::StatusOr<FrameMemory> Renderer::allocate(const FrameDesc& desc, const Settings& settings,
                                               Verify verify) {
  absl::StatusOr<std::unique_ptr<FrameMemory::Parts>> parts =
      take_parts(impl_->pool, impl_->device.summary(), desc, settings, verify);
  if (!parts.ok()) return parts.status();
  FrameMemory memory;
  memory.parts_ = *std::move(parts);
  return memory;
}

absl::StatusOr<FrameReport> Renderer::render(FrameMemory& memory, const Settings& settings,
                                             const FrameMoment& moment) {
  const absl::StatusOr<Metered> metered = meter(memory, settings);
  if (!metered.ok()) return metered.status();
  const Exposed exposed = expose(settings.exposure, moment.previous, metered->stats.mean_log2_luminance);
  return draw(memory, settings, moment.sequence, *metered, exposed);
}

absl::StatusOr<Metered> Renderer::meter(FrameMemory& memory, const Settings& settings) {
  const FrameMemory::Parts& parts = *memory.parts_;
  impl_->pipelines.trim(kMaxPipelines);
  PassContext context = pass_context(parts, settings);
  Metered metered;
  absl::StatusOr<TileSums> sums = impl_->measure(context, /*upload=*/true, &metered.stages);
  if (sums.ok() && sums->needs_scrub) {
    context.scrub = metered.scrubbed = true;
    sums = impl_->measure(context, /*upload=*/false, &metered.stages);
  }
  if (!sums.ok()) return sums.status();
  metered.stats = std::move(sums->stats);
  if (settings.bad_values == BadValues::kReject && sums->first_bad_texel != UINT32_MAX) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the pixel at x %d, y %d is not finite (%d NaN and %d infinite components in all); "
                        "repair the frame or use "
                        "bad_values SCRUB",
                        sums->first_bad_texel % parts.desc.width, sums->first_bad_texel / parts.desc.width,
                        metered.stats.nan_components, metered.stats.infinite_components));
  }
  if (context.tier.host_reference) {
    add_host_time(name(Pass::kReference), &metered.stages, [&] {
      metered.stats.mean_log2_luminance = reference_mean_log2_luminance(memory, settings);
    });
  }
  return metered;
}

absl::StatusOr<FrameReport> Renderer::draw(FrameMemory& memory, const Settings& settings, uint64_t sequence,
                                           const Metered& metered, const Exposed& exposed) {
  const FrameMemory::Parts& parts = *memory.parts_;
  impl_->pipelines.trim(kMaxPipelines);
  PassContext context = pass_context(parts, settings);
  context.scrub = metered.scrubbed;
  FrameReport report;
  report.stats = metered.stats;
  report.stages = metered.stages;
  report.plan = plan_frame(parts.desc, report.stats, context.scrub, settings, context.tier);
  report.exposure = exposed.exposure;
  report.target = exposed.target;
  const FrameMoment moment{sequence, std::nullopt};
  if (context.tier.host_reference) {
    add_host_time(name(Pass::kReference), &report.stages,
                  [&] { render_by_reference(memory, settings, moment, exposed.exposure); });
  } else {
    context.exposure = exposed.exposure * settings.prescale;
    context.bloom = report.plan.bloom;
    context.lit = report.plan.lit;
    context.bright_threshold = bright_threshold(settings.bloom, report.stats);
    context.dither_frame = static_cast<uint32_t>(sequence);
    if (absl::Status status = impl_->load_table(context); !status.ok()) return status;
    if (absl::Status status = impl_->draw(context, report.plan); !status.ok()) return status;
    add_timings(impl_->recorder, &report.stages);
  }
  if (parts.exact) {
    add_host_time(kVerify, &report.stages,
                  [&] { report.verification = verify_frame(memory, settings, report, moment); });
  }
  return report;
}

}  // namespace candela
