#include "server/render/renderer.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <cstring>
#include <functional>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/render/aces.h"
#include "server/render/exposure.h"
#include "server/render/frame_memory.h"
#include "server/render/metering.h"
#include "server/render/passes.h"
#include "server/render/table_cache.h"
#include "server/render/verify.h"
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

double percentile_of(const FrameMemory::Parts& parts, const MeteringSettings& metering) {
  const double offset_ev = (metering.weights == MeterWeights::kCenter ? 256.0 : 1.0) / kFixedPointPerEv;
  std::vector<MeterBin> bins(shader::HISTOGRAM_BINS);
  for (size_t i = 0; i < size_t{parts.histogram_copies} * shader::HISTOGRAM_BINS; ++i) {
    shader::HistogramBin bin;
    std::memcpy(&bin, parts.host_histogram().mapped() + i * sizeof bin, sizeof bin);
    bins[i % shader::HISTOGRAM_BINS].weight += bin.weight;
    bins[i % shader::HISTOGRAM_BINS].above_ev += bin.offset_sum * offset_ev;
  }
  return percentile_mean(bins, metering.percentile_low, metering.percentile_high);
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
  uint32_t bloom_luminance = 0;
  const size_t count = size_t{parts.tiles_x} * parts.tiles_y;
  for (size_t i = 0; i < count; ++i) {
    shader::TileRecord tile;
    std::memcpy(&tile, parts.host_tiles().mapped() + i * sizeof tile, sizeof tile);
    fixed_log2 += tile.log2_sum_low + (uint64_t{tile.log2_sum_high} << 16);
    brightest = std::max(brightest, tile.max_luminance_bits);
    darkest_inverted = std::max(darkest_inverted, tile.min_luminance_bits_inverted);
    magnitude = std::max(magnitude, tile.max_magnitude_bits);
    stats.nan_components += tile.nan_components;
    stats.infinite_components += tile.infinite_components;
    stats.negative_components += tile.negative_components;
    stats.bright_texels += tile.bright_texels;
    weight += tile.weight_sum;
    bloom_luminance = std::max(bloom_luminance, tile.max_bloom_luminance_bits);
    sums.first_bad_texel = std::min(sums.first_bad_texel, ~tile.first_bad_texel_inverted);
  }
  stats.metered_weight = settings.exposure.metering.weights == MeterWeights::kAverage
                             ? uint64_t{parts.desc.width} * parts.desc.height
                             : weight;
  stats.mean_log2_luminance =
      parts.histogram_copies > 0
          ? percentile_of(parts, settings.exposure.metering)
          : static_cast<double>(fixed_log2) / (kFixedPointPerEv * static_cast<double>(stats.metered_weight)) -
                shader::LOG2_BIAS;
  stats.max_bloom_luminance = std::bit_cast<float>(bloom_luminance);
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

}  // namespace

namespace {

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
  const FrameMemory::Parts& parts = *memory.parts_;
  impl_->pipelines.trim(kMaxPipelines);
  PassContext context = pass_context(parts, settings);
  FrameReport report;
  absl::StatusOr<TileSums> sums = impl_->measure(context, /*upload=*/true, &report.stages);
  if (sums.ok() && sums->needs_scrub) {
    context.scrub = true;
    sums = impl_->measure(context, /*upload=*/false, &report.stages);
  }
  if (!sums.ok()) return sums.status();
  report.stats = sums->stats;
  if (settings.bad_values == BadValues::kReject && sums->first_bad_texel != UINT32_MAX) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the pixel at x %d, y %d is not finite (%d NaN and %d infinite components in all); "
                        "repair the frame or use "
                        "bad_values SCRUB",
                        sums->first_bad_texel % parts.desc.width, sums->first_bad_texel / parts.desc.width,
                        report.stats.nan_components, report.stats.infinite_components));
  }
  const auto expose = [&](double mean_log2_luminance) {
    report.stats.mean_log2_luminance = mean_log2_luminance;
    report.target = exposure_target(settings.exposure, mean_log2_luminance);
    const bool metered = settings.exposure.mode == ExposureMode::kAuto;
    report.exposure =
        adapt_exposure(settings.exposure.adaptation, metered ? moment.previous : std::nullopt, report.target);
    return report.exposure;
  };
  expose(report.stats.mean_log2_luminance);
  report.plan = plan_frame(parts.desc, report.stats, context.scrub, settings, context.tier);

  context.bloom = report.plan.bloom;
  context.gaussian_threshold = gaussian_threshold(settings.bloom, report.stats);
  context.dither_frame = static_cast<uint32_t>(moment.sequence);
  context.exposure = report.exposure * settings.prescale;
  if (context.tier.host_reference) {
    add_host_time(name(Pass::kReference), &report.stages,
                  [&] { render_by_reference(memory, settings, moment, expose); });
  } else {
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
