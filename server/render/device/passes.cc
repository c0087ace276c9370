#include "server/render/device/passes.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <span>
#include <type_traits>
#include <utility>

#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "shaders/bloom_down.spv.h"
#include "shaders/bloom_up.spv.h"
#include "shaders/bright_pass.spv.h"
#include "shaders/gaussian.spv.h"
#include "shaders/ingest.spv.h"
#include "shaders/resize.spv.h"
#include "shaders/resolve.spv.h"

namespace candela {

absl::StatusOr<std::shared_ptr<const Buffer>> TableCache::get(const std::shared_ptr<const ColorTable>& table,
                                                              Recorder& recorder) {
  if (std::shared_ptr<const Buffer> found = tables_.find(table)) return found;
  tables_.make_room();
  const uint64_t bytes = point_count(*table) * sizeof(TablePoint);
  ASSIGN_OR_RETURN(Buffer points, Buffer::create(device_, bytes, MemoryUse::kDevice));
  if (device_.unified_memory()) {
    write_points(*table, points.mapped());
  } else {
    ASSIGN_OR_RETURN(Buffer upload, Buffer::create(device_, bytes, MemoryUse::kUpload));
    write_points(*table, upload.mapped());
    RETURN_IF_ERROR(recorder.begin());
    recorder.copy(upload, points, bytes);
    RETURN_IF_ERROR(recorder.submit_and_wait());
  }
  return tables_.keep(table, std::move(points));
}

namespace {

static_assert(shader::TILE_TEXELS % (shader::INGEST_GROUP_X * shader::GROUP_TEXELS) == 0);
static_assert(shader::INGEST_GROUP_Y * shader::INGEST_ROWS == shader::TILE_TEXELS);
static_assert(sizeof(shader::IngestParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::BrightPassParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::GaussianParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::BloomLevelParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::ResizeParams) <= PipelineCache::kPushBytes);
static_assert(sizeof(shader::ResolveParams) <= PipelineCache::kPushBytes);

// A struct of specialisation constants as the words of ids 0, 1, 2 ...
template <typename T>
Constants words_of(const T& constants) {
  if constexpr (std::is_empty_v<T>) {
    return {};
  } else {
    const auto words = std::bit_cast<std::array<uint32_t, sizeof(T) / sizeof(uint32_t)>>(constants);
    return {words.begin(), words.end()};
  }
}

// The buffer that a pass writes, one row of work groups after another. Rows are whole words of 16 bytes.
struct Target {
  const Buffer& buffer;
  uint64_t row_bytes;
  uint32_t rows;
  uint32_t group_rows;  // that a work group writes
};

// The part of `groups` within rows.
std::vector<Box> within(std::span<const Box> groups, const GroupRows& rows) {
  std::vector<Box> part;
  for (const Box& box : groups) {
    const Box cut = {box.x0, std::max(box.y0, rows.first), box.x1, std::min(box.y1, rows.last)};
    if (cut.y0 < cut.y1) part.push_back(cut);
  }
  return part;
}

void dispatch_all(std::span<const Box> groups, Recorder& recorder) {
  for (const Box& box : groups) recorder.dispatch(box.x0, box.y0, box.x1, box.y1);
}

// Dispatches as often as it takes to bind all of the target for writing, and tells each part its first row.
template <typename Inputs>
absl::Status dispatch(PipelineCache& pipelines, Recorder& recorder, std::span<const uint32_t> spirv,
                      const Inputs& inputs, std::initializer_list<VkBufferView> reads, const Target& target,
                      std::span<const Box> work, const GroupRows& of) {
  ASSIGN_OR_RETURN(const VkPipeline pipeline, pipelines.get(spirv, words_of(inputs.constants)));
  // Each part has to begin at a row of work groups, and where a binding may begin.
  const uint64_t step = target.group_rows * PipelineCache::kWriteAlignment / 16;
  const uint64_t rows = PipelineCache::kMaxWriteBytes / target.row_bytes / step * step;
  CHECK(rows > 0 && target.rows * target.row_bytes <= target.buffer.bytes());
  for (const Box& box : work) CHECK(box.y1 <= groups(target.rows, target.group_rows));
  for (uint64_t first = 0; first < target.rows; first += rows) {
    const auto begin = static_cast<uint32_t>(first / target.group_rows);
    const auto end =
        static_cast<uint32_t>(std::min<uint64_t>(UINT32_MAX, (first + rows) / target.group_rows));
    const std::vector<Box> part = within(work, {std::max(begin, of.first), std::min(end, of.last)});
    if (part.empty()) continue;
    auto params = inputs.params;
    params.first_row = static_cast<uint32_t>(first);
    const VkDescriptorBufferInfo written = {target.buffer.handle(), first * target.row_bytes,
                                            std::min<uint64_t>(rows, target.rows - first) * target.row_bytes};
    recorder.bind(pipeline, pipelines.layout(), {reads.begin(), reads.size()}, written, &params,
                  sizeof params);
    dispatch_all(part, recorder);
  }
  return absl::OkStatus();
}

// Of a pass of the bloom.
std::span<const uint32_t> spirv_of(Pass pass) {
  if (pass == Pass::kBrightPass) return k_bright_pass_spirv;
  if (pass == Pass::kBloomDown) return k_bloom_down_spirv;
  if (pass == Pass::kBloomUp) return k_bloom_up_spirv;
  CHECK(pass == Pass::kGaussian);
  return k_gaussian_spirv;
}

// The texel buffers that a pass of the bloom reads.
std::array<VkBufferView, 2> reads_of(const BloomStep& step, const FrameTextures& textures) {
  if (step.pass == Pass::kBrightPass) {
    return {textures.input.buffer().view(), textures.input.buffer().view()};
  }
  const VkBufferView from = textures.levels[step.from_level].buffer().view();
  if (step.pass == Pass::kGaussian) return {from, from};
  return {from, textures.levels[step.level].buffer().view()};
}

// Writes into `output` in an OUTPUT_* format with `texel_bytes` bytes a texel.
absl::Status record_resolve(const ResolveStep& step, const TableBuffers& tables,
                            const FrameTextures& textures, PipelineCache& pipelines, Recorder& recorder,
                            const GroupRows& rows, const Buffer& output, uint32_t format,
                            uint64_t texel_bytes) {
  const TextureLayout& layout = textures.layout;
  const bool resized = step.inputs.constants.pixels == shader::PIXELS_SCENE;
  const VkBufferView frame = (resized ? textures.scene : textures.input).buffer().view();
  // A binding that the shader does not use still has to hold something.
  const VkBufferView table_view = tables.colors == nullptr ? frame : tables.colors->view();
  const VkBufferView gain_view = tables.gain == nullptr ? frame : tables.gain->view();
  const Target target = {output, layout.image_pitch * texel_bytes, layout.image.height, kResolveGroupRows};
  auto inputs = step.inputs;
  inputs.constants.output_format = format;
  inputs.params.tiles_lo = low(textures.tiles.buffer().address());
  inputs.params.tiles_hi = high(textures.tiles.buffer().address());
  absl::Status status;
  if (!step.bloom_groups.empty()) {
    const VkBufferView bloom = textures.levels[0].buffer().view();
    status = dispatch(pipelines, recorder, k_resolve_spirv, inputs, {frame, bloom, table_view, gain_view},
                      target, step.bloom_groups, rows);
  }
  if (!step.plain_groups.empty()) {
    inputs.constants.bloom = shader::BLOOM_NONE;
    status.Update(dispatch(pipelines, recorder, k_resolve_spirv, inputs,
                           {frame, frame, table_view, gain_view}, target, step.plain_groups, rows));
  }
  return status;
}

}  // namespace

Box ingest_groups(const TextureLayout& layout) {
  return {0, 0, groups(layout.tiles_x, shader::INGEST_TILES), layout.tiles_y};
}

absl::Status record_ingest(const IngestPlan& plan, const IngestRead& read, const FrameTextures& textures,
                           PipelineCache& pipelines, Recorder& recorder, const GroupRows& rows) {
  const TextureLayout& layout = textures.layout;
  const VkDeviceAddress tiles = textures.tiles.buffer().address();
  const VkDeviceAddress histogram = textures.histogram ? textures.histogram.buffer().address() : 0;
  auto [constants, params] = plan.inputs;
  constants.scrub = read.scrub;
  constants.alpha = read.alpha;
  params.tiles_lo = low(tiles);
  params.tiles_hi = high(tiles);
  params.histogram_lo = low(histogram);
  params.histogram_hi = high(histogram);
  ASSIGN_OR_RETURN(const VkPipeline pipeline, pipelines.get(k_ingest_spirv, words_of(constants)));
  const VkBufferView frame = textures.input.buffer().view();
  const VkBufferView reads[] = {frame,
                                textures.center_weights ? textures.center_weights.buffer().view() : frame};
  const Box all = ingest_groups(layout);
  recorder.bind(pipeline, pipelines.layout(), reads, {}, &params, sizeof params);
  dispatch_all(within({&all, 1}, rows), recorder);
  return absl::OkStatus();
}

absl::Status record_bloom(const BloomStep& step, const FrameTextures& textures, PipelineCache& pipelines,
                          Recorder& recorder, const GroupRows& rows) {
  const LevelSize& size = textures.layout.level_sizes[step.level];
  const Buffer& level = textures.levels[step.level].buffer();
  const Target target = {level, uint64_t{size.width} * 4 * sizeof(float), size.height, step.group_rows};
  const auto [first, second] = reads_of(step, textures);
  return std::visit(
      [&, first = first, second = second](const auto& inputs) {
        return dispatch(pipelines, recorder, spirv_of(step.pass), inputs, {first, second}, target,
                        step.groups, rows);
      },
      step.inputs);
}

Box resize_groups(const ResizeStep& step, bool down, uint32_t block, const TextureLayout& layout) {
  const uint32_t columns = down ? groups(step.across.from, shader::GROUP_TEXELS) : step.across.to;
  const uint32_t rows = std::min(layout.resize_rows, layout.image.height - block);
  const uint32_t first = down ? 0 : block;  // of what is written
  return {0, first, groups(columns, shader::RESIZE_GROUP_X), first + rows};
}

double resize_group_texels(const ResizeStep& step, bool down) {
  const double texels = shader::RESIZE_GROUP_X;
  return down ? texels * shader::GROUP_TEXELS * step.down.taps : texels * step.across.taps;
}

absl::Status record_resize(const ResizeStep& step, bool down, uint32_t block, const FrameTextures& textures,
                           PipelineCache& pipelines, Recorder& recorder, const GroupRows& rows) {
  const TextureLayout& layout = textures.layout;
  const shader::ResolveConstants& frame = step.frame.inputs.constants;
  const shader::ResolveParams& params = step.frame.inputs.params;
  const bool blooms = !step.frame.bloom_groups.empty();
  const AxisFilter& filter = down ? step.down : step.across;
  // Along x the pass knows nothing of the frame.
  const shader::ResizeConstants across = {.pixels = shader::PIXELS_SCENE,
                                          .matrix = 0,
                                          .scrub = 0,
                                          .bloom = shader::BLOOM_NONE,
                                          .level_size = kWholeBloom,
                                          .wide = 0,
                                          .unrounded = 0,
                                          .down = 0};
  const shader::ResizeConstants from_frame = {.pixels = frame.pixels,
                                              .matrix = frame.matrix,
                                              .scrub = frame.scrub,
                                              .bloom = blooms ? frame.bloom : shader::BLOOM_NONE,
                                              .level_size = frame.level_size,
                                              .wide = frame.wide,
                                              .unrounded = frame.unrounded,
                                              .down = 1};
  const ShaderInputs<shader::ResizeConstants, shader::ResizeParams> inputs = {
      .constants = down ? from_frame : across,
      .params = {.frame = params.frame,
                 .first_row = 0,
                 .level_width = params.level_width,
                 .level_height = params.level_height,
                 .bloom_scale = params.bloom_scale,
                 .scene_scale = params.scene_scale,
                 .from = filter.from,
                 .to = filter.to,
                 .mean = filter.mean,
                 .taps = filter.taps,
                 .weights = down ? 0 : static_cast<uint32_t>(step.down.weights.size()),
                 .block_row = block,
                 .from_pitch = layout.resize_pitch,
                 .to_pitch = down ? layout.resize_pitch : layout.image_pitch}};
  const Buffer& from = (down ? textures.input : textures.resize_block).buffer();
  const Buffer& level = blooms ? textures.levels[0].buffer() : from;
  const Target target = {(down ? textures.resize_block : textures.scene).buffer(),
                         inputs.params.to_pitch * 4 * sizeof(float),
                         down ? layout.resize_rows : layout.image.height, 1};
  const Box work = resize_groups(step, down, block, layout);
  return dispatch(pipelines, recorder, k_resize_spirv, inputs,
                  {from.view(), level.view(), textures.resize_weights.buffer().view()}, target, {&work, 1},
                  rows);
}

absl::Status record_resolve(const ResolveStep& step, const TableBuffers& tables,
                            const FrameTextures& textures, PipelineCache& pipelines, Recorder& recorder,
                            const GroupRows& rows) {
  const v1::OutputFormat format = textures.layout.output_format;
  return record_resolve(step, tables, textures, pipelines, recorder, rows, textures.output.buffer(),
                        static_cast<uint32_t>(format), bytes_per_pixel(format));
}

absl::Status record_exact(const ResolveStep& step, const TableBuffers& tables, const FrameTextures& textures,
                          PipelineCache& pipelines, Recorder& recorder, const GroupRows& rows) {
  return record_resolve(step, tables, textures, pipelines, recorder, rows, textures.exact.buffer(),
                        shader::OUTPUT_FLOAT, 4 * sizeof(float));
}

}  // namespace candela
