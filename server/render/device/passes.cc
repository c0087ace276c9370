#include "server/render/device/passes.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "server/render/color/primaries.h"
#include "server/render/plan/lit_area.h"
#include "shaders/bloom_down.spv.h"
#include "shaders/bloom_up.spv.h"
#include "shaders/bright_pass.spv.h"
#include "shaders/gaussian.spv.h"
#include "shaders/ingest.spv.h"
#include "shaders/resolve.spv.h"

namespace candela {

namespace {

static_assert(shader::TILE_TEXELS % (shader::INGEST_GROUP_X * shader::GROUP_TEXELS) == 0);
static_assert(shader::INGEST_GROUP_Y * shader::INGEST_ROWS == shader::TILE_TEXELS);
static_assert(sizeof(shader::IngestParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::BrightPassParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::GaussianParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::BloomParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::ResolveParams) <= PipelineCache::kPushBytes);

// A knee whose square a device may flush to 0 would divide 0 by 0; it is no knee.
constexpr float kMinKnee = 1e-15f;

uint32_t level_size(const PassContext& context) {
  return context.settings.bloom.kind == BloomKind::kGaussian ? 4 : context.tier.bloom_level_size;
}

// gaussian.comp's taps on either side.
constexpr uint32_t kGaussianReach = 6;

// The input's rows end with a whole group of texels.
bool whole_groups(const FrameMemory::Parts& parts) { return parts.desc.width % shader::GROUP_TEXELS == 0; }

// The first level stands for a finer one, too.
bool first_level_twice(const PassContext& context) {
  return context.tier.bloom_level_size == 4 && context.parts.levels.size() > 1;
}

constexpr uint32_t low(VkDeviceAddress address) { return static_cast<uint32_t>(address); }
constexpr uint32_t high(VkDeviceAddress address) { return static_cast<uint32_t>(address >> 32); }

// What a pass writes, a row of work groups after the other. Rows are whole words of 16 bytes.
struct Target {
  const Buffer& buffer;
  uint64_t row_bytes;
  uint32_t rows;
  uint32_t group_rows;  // that a work group makes
};

Target level_target(const FrameMemory::Parts& parts, uint32_t level, uint32_t group_rows) {
  const LevelSize& size = parts.level_sizes[level];
  return {parts.levels[level].buffer(), uint64_t{size.width} * 4 * sizeof(float), size.height, group_rows};
}

// As often as it takes to bind all of the target for writing; `params` gets the first row of each part.
template <typename Params>
absl::Status dispatch(PipelineCache& pipelines, Recorder& recorder, std::span<const uint32_t> spirv,
                      const Constants& constants, std::initializer_list<VkBufferView> reads, Params params,
                      const Target& target, std::span<const Box> work) {
  const absl::StatusOr<VkPipeline> pipeline = pipelines.get(spirv, constants);
  if (!pipeline.ok()) return pipeline.status();
  // So many that each part begins at a row of groups, and where a binding may.
  const uint64_t step = target.group_rows * PipelineCache::kWriteAlignment / 16;
  const uint64_t rows = PipelineCache::kMaxWriteBytes / target.row_bytes / step * step;
  for (uint64_t first = 0; first < target.rows; first += rows) {
    const auto begin = static_cast<uint32_t>(first / target.group_rows);
    const auto end =
        static_cast<uint32_t>(std::min<uint64_t>(UINT32_MAX, (first + rows) / target.group_rows));
    std::vector<Box> part;
    for (const Box& box : work) {
      const Box within = {box.x0, std::max(box.y0, begin), box.x1, std::min(box.y1, end)};
      if (within.y0 < within.y1) part.push_back(within);
    }
    params.first_row = static_cast<uint32_t>(first);
    const VkDescriptorBufferInfo written = {target.buffer.handle(), first * target.row_bytes,
                                            std::min<uint64_t>(rows, target.rows - first) * target.row_bytes};
    recorder.dispatch(*pipeline, pipelines.layout(), {reads.begin(), reads.size()}, written, &params,
                      sizeof params, part);
  }
  return absl::OkStatus();
}

// Texels that light may be in after a step of the bloom, of the level that the step writes.
Area lit_after(const PassContext& context, const Step& step) {
  const std::vector<LevelSize>& sizes = context.parts.level_sizes;
  Area area = in_level({context.lit.begin(), context.lit.end()}, level_size(context));
  if (step.pass == Pass::kBrightPass) return area;
  if (step.pass == Pass::kGaussian) {
    area = after_gaussian(area, sizes[1], 0, kGaussianReach);
    return step.level == 1 ? area : after_gaussian(area, sizes[0], kGaussianReach, 0);
  }
  const bool up = step.pass == Pass::kBloomUp;
  const auto last = static_cast<uint32_t>(up ? sizes.size() - 1 : step.level);
  for (uint32_t level = 1; level <= last; ++level) area = after_bloom_down(area, sizes[level]);
  for (uint32_t level = last; up && level-- > step.level;) area = after_bloom_up(area, sizes[level]);
  return area;
}

// The groups of a step that writes level `step.level`, `width` x `height` of its texels each. Where they are
// not all there are, and the level holds nothing yet, the rest of it is cleared.
std::vector<Box> groups_of(const PassContext& context, const Step& step, uint32_t width, uint32_t height,
                           Recorder& recorder) {
  const LevelSize& size = context.parts.level_sizes[step.level];
  Cover work =
      cover(lit_after(context, step), width, height, groups(size.width, width), groups(size.height, height));
  const bool in_place = step.pass == Pass::kBloomUp || (step.pass == Pass::kGaussian && step.level == 0);
  if (!work.whole() && !in_place) {
    recorder.fill_zero(context.parts.levels[step.level].buffer());
    recorder.barrier();
  }
  return std::move(work.groups);
}

absl::Status record_ingest(const PassContext& context, PipelineCache& pipelines, Recorder& recorder) {
  const FrameMemory::Parts& parts = context.parts;
  const VkDeviceAddress tiles_address = parts.tiles.buffer().address();
  shader::IngestParams params{};
  params.frame = context.input;
  params.tiles_lo = low(tiles_address);
  params.tiles_hi = high(tiles_address);
  params.tiles_x = parts.tiles_x;
  const bool histogram = parts.histogram_copies > 0;
  const VkDeviceAddress histogram_address = histogram ? parts.histogram.buffer().address() : 0;
  params.histogram_lo = low(histogram_address);
  params.histogram_hi = high(histogram_address);
  const MeteringSettings& metering = context.settings.exposure.metering;
  params.spot_x0 = metering.spot.x0;
  params.spot_y0 = metering.spot.y0;
  params.spot_x1 = metering.spot.x1;
  params.spot_y1 = metering.spot.y1;
  const Constants constants = {
      static_cast<uint32_t>(parts.desc.format), context.matrix, context.scrub,      !parts.levels.empty(),
      static_cast<uint32_t>(metering.weights),  histogram,      whole_groups(parts)};
  const VkBufferView frame = parts.input.buffer().view();
  const Box all = {0, 0, groups(parts.tiles_x, shader::INGEST_TILES), parts.tiles_y};
  const absl::StatusOr<VkPipeline> pipeline = pipelines.get(k_ingest_spirv, constants);
  if (!pipeline.ok()) return pipeline.status();
  const VkBufferView reads[] = {frame, parts.center_weights ? parts.center_weights.buffer().view() : frame};
  recorder.dispatch(*pipeline, pipelines.layout(), reads, {}, &params, sizeof params, {&all, 1});
  return absl::OkStatus();
}

absl::Status record_bright_pass(const PassContext& context, const Step& step, PipelineCache& pipelines,
                                Recorder& recorder) {
  const FrameMemory::Parts& parts = context.parts;
  const BloomSettings& bloom = context.settings.bloom;
  shader::BrightPassParams params{};
  params.frame = context.input;
  params.level_width = parts.level_sizes[0].width;
  params.threshold = context.bright_threshold;
  const float knee = bloom.softness * bloom.threshold;
  params.knee = knee < kMinKnee ? 0.0f : knee;
  const uint32_t size = level_size(context);
  const Constants constants = {static_cast<uint32_t>(parts.desc.format),
                               context.matrix,
                               context.scrub,
                               static_cast<uint32_t>(bloom.kind),
                               bloom.firefly_weights,
                               size,
                               whole_groups(parts)};
  const uint32_t width = shader::GROUP_TEXELS * shader::BRIGHT_GROUP_X * shader::BRIGHT_STEPS;
  const uint32_t height = shader::BRIGHT_ROWS * shader::BRIGHT_GROUP_Y;
  return dispatch(pipelines, recorder, k_bright_pass_spirv, constants, {parts.input.buffer().view()}, params,
                  level_target(parts, 0, height / size),
                  groups_of(context, step, width / size, height / size, recorder));
}

// From level `from` to the step's; an invocation makes `columns` columns and BLOOM_ROWS * columns rows of it.
absl::Status record_bloom(const PassContext& context, const Step& step, PipelineCache& pipelines,
                          Recorder& recorder, std::span<const uint32_t> spirv, const Constants& constants,
                          uint32_t from, uint32_t columns) {
  const FrameMemory::Parts& parts = context.parts;
  const uint32_t to = step.level;
  const uint32_t rows = columns * shader::BLOOM_ROWS * shader::BLOOM_GROUP_Y;
  shader::BloomParams params{};
  params.from_width = parts.level_sizes[from].width;
  params.from_height = parts.level_sizes[from].height;
  params.to_width = parts.level_sizes[to].width;
  params.to_height = parts.level_sizes[to].height;
  return dispatch(pipelines, recorder, spirv, constants,
                  {parts.levels[from].buffer().view(), parts.levels[to].buffer().view()}, params,
                  level_target(parts, to, rows),
                  groups_of(context, step, columns * shader::BLOOM_GROUP_X, rows, recorder));
}

// To level 1: vertical, from level 0; to level 0: horizontal, from level 1.
absl::Status record_gaussian(const PassContext& context, const Step& step, PipelineCache& pipelines,
                             Recorder& recorder) {
  const FrameMemory::Parts& parts = context.parts;
  const uint32_t to = step.level;
  constexpr uint32_t kRows = shader::BLOOM_ROWS * shader::BLOOM_GROUP_Y;
  shader::GaussianParams params{};
  params.width = parts.level_sizes[to].width;
  params.height = parts.level_sizes[to].height;
  const VkBufferView from = parts.levels[1 - to].buffer().view();
  // The second binding is not used.
  return dispatch(pipelines, recorder, k_gaussian_spirv, {to}, {from, from}, params,
                  level_target(parts, to, kRows),
                  groups_of(context, step, shader::BLOOM_GROUP_X, kRows, recorder));
}

uint32_t curve_constant(const PassContext& context) {
  if (context.table != nullptr && context.table->axes == shader::AXES_REC709)
    return shader::CURVE_TABLE_REC709;
  return static_cast<uint32_t>(context.settings.curve);
}

// That a work group of resolve makes.
constexpr uint32_t kResolveRows = shader::RESOLVE_ROWS * shader::RESOLVE_GROUP_Y;

// The rows of groups that bloom reaches, and the rest. Whole rows: what a shorter walk along them costs is
// more than what is saved where there is no bloom.
Cover resolve_groups(const PassContext& context) {
  const FrameDesc& desc = context.parts.desc;
  constexpr uint32_t kWidth = shader::GROUP_TEXELS * shader::RESOLVE_GROUP_X * shader::RESOLVE_STEPS;
  Area reached;
  if (context.bloom) {
    const Pass last = context.settings.bloom.kind == BloomKind::kGaussian ? Pass::kGaussian : Pass::kBloomUp;
    reached = in_frame(lit_after(context, {last, 0}), level_size(context), desc.width, desc.height);
  }
  Cover rows = cover(reached, desc.width, kResolveRows, 1, groups(desc.height, kResolveRows));
  for (std::vector<Box>* part : {&rows.groups, &rows.rest}) {
    for (Box& box : *part) box.x1 = groups(desc.width, kWidth);
  }
  return rows;
}

// Into `output`, in a format of OUTPUT_* with so many bytes a texel.
absl::Status record_resolve(const PassContext& context, PipelineCache& pipelines, Recorder& recorder,
                            const Buffer& output, uint32_t format, uint64_t texel_bytes) {
  const FrameMemory::Parts& parts = context.parts;
  shader::ResolveParams params{};
  params.frame = context.input;
  params.output_pitch = parts.pitch;
  // 2^46 is beyond where any curve still rises for a half's smallest step; it keeps the arithmetic finite.
  params.exposure = static_cast<float>(std::min(context.exposure, 0x1p46));
  params.curve_white = context.settings.curve_white;
  params.dither_frame = context.dither_frame;
  VkBufferView table = parts.input.buffer().view();
  if (context.table != nullptr) {
    table = context.table_points->view();
    params.table_size = context.table->size;
    params.table_scale =
        static_cast<float>(std::ldexp(context.table->size - 1, shader::TABLE_FRACTION_BITS) /
                           table_octaves(context.table->end / shader::TABLE_AXIS_KNEE + 1.0));
  }
  // A binding that the shader does not use still has to hold something.
  VkBufferView bloom = parts.input.buffer().view();
  if (context.bloom) {
    bloom = parts.levels[0].buffer().view();
    params.level_width = parts.level_sizes[0].width;
    params.level_height = parts.level_sizes[0].height;
    const float intensity = context.settings.bloom.intensity;
    params.bloom_scale = intensity / static_cast<float>(summed_levels(context));
    params.scene_scale = 1.0f - intensity;
  }
  const Cover work = resolve_groups(context);
  const auto make = [&](std::span<const Box> part, uint32_t bloom_kind) {
    if (part.empty()) return absl::OkStatus();
    const Constants constants = {static_cast<uint32_t>(parts.desc.format),
                                 context.matrix,
                                 context.scrub,
                                 bloom_kind,
                                 curve_constant(context),
                                 static_cast<uint32_t>(output_transfer(context.settings)),
                                 format,
                                 context.settings.dither && parts.output_format != OutputFormat::kRgba16f,
                                 level_size(context),
                                 context.tier.transfer_terms};
    return dispatch(pipelines, recorder, k_resolve_spirv, constants,
                    {parts.input.buffer().view(), bloom, table}, params,
                    {output, parts.pitch * texel_bytes, parts.desc.height, kResolveRows}, part);
  };
  absl::Status status = make(work.groups, static_cast<uint32_t>(context.settings.bloom.kind));
  status.Update(make(work.rest, shader::BLOOM_NONE));
  return status;
}

}  // namespace

PassContext pass_context(const FrameMemory::Parts& parts, const Settings& settings) {
  PassContext context{parts, settings, *find_tier(settings.tier), {}};
  std::array<float, 9> m = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  if (settings.input_chromaticities) {
    // check_settings has seen to it that there is one.
    if (const auto matrix = matrix_to_rec709(*settings.input_chromaticities);
        matrix.ok() && matrix->has_value()) {
      m = **matrix;
      context.matrix = true;
    }
  }
  context.input = {
      parts.desc.width, parts.desc.height, parts.pitch, m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8]};
  return context;
}

uint32_t summed_levels(const PassContext& context) {
  if (context.settings.bloom.kind == BloomKind::kGaussian) return 1;
  return static_cast<uint32_t>(context.parts.levels.size()) + first_level_twice(context);
}

absl::Status record(const Step& step, const PassContext& context, PipelineCache& pipelines,
                    Recorder& recorder) {
  switch (step.pass) {
    case Pass::kIngest:
      return record_ingest(context, pipelines, recorder);
    case Pass::kBrightPass:
      return record_bright_pass(context, step, pipelines, recorder);
    case Pass::kBloomDown:
      return record_bloom(context, step, pipelines, recorder, k_bloom_down_spirv, {}, step.level - 1, 1);
    case Pass::kBloomUp: {
      const float fine_weight = step.level == 0 && first_level_twice(context) ? 2.0f : 1.0f;
      return record_bloom(context, step, pipelines, recorder, k_bloom_up_spirv,
                          {std::bit_cast<uint32_t>(fine_weight)}, step.level + 1, 2);
    }
    case Pass::kGaussian:
      return record_gaussian(context, step, pipelines, recorder);
    case Pass::kResolve:
      return record_resolve(context, pipelines, recorder, context.parts.output.buffer(),
                            static_cast<uint32_t>(context.parts.output_format),
                            bytes_per_pixel(context.parts.output_format));
    case Pass::kReference:
      break;  // nothing of the device's
  }
  return absl::InternalError("unknown pass");
}

absl::Status record_exact(const PassContext& context, PipelineCache& pipelines, Recorder& recorder) {
  return record_resolve(context, pipelines, recorder, context.parts.exact.buffer(), shader::OUTPUT_FLOAT,
                        4 * sizeof(float));
}

}  // namespace candela
