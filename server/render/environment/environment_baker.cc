#include "server/render/environment/environment_baker.h"

#include <half.h>

#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "server/base/check.h"
#include "server/base/slices.h"
#include "server/base/status_macros.h"
#include "server/render/environment/view_tiles.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/plan/texture_layout.h"
#include "shaders/brdf_table.spv.h"
#include "shaders/cube_down.spv.h"
#include "shaders/cube_face.spv.h"
#include "shaders/cube_specular.spv.h"
#include "shaders/environment/environment_params.h"
#include "shaders/panorama.spv.h"
#include "shaders/panorama_sh.spv.h"
#include "shaders/view.spv.h"

namespace candela {
namespace {

// Before the pace of a pass is known, a look-up counts as this slow. The software device takes 12 to 25 ns.
constexpr double kFirstBakePace = 60e-9;
// What is read at a time from memory that is not mapped.
constexpr uint64_t kReadBytes = uint64_t{16} << 20;
constexpr uint64_t kMaxGroups = 65535;  // that every device can run side by side

}  // namespace

LongPasses::LongPasses(TexturePool& pool, PipelineCache pipelines, Recorder recorder)
    : pool_(&pool), pipelines_(std::move(pipelines)), recorder_(std::move(recorder)), pace_(kFirstBakePace) {}

absl::StatusOr<LongPasses> LongPasses::create(const Device& device, TexturePool& pool) {
  ASSIGN_OR_RETURN(PipelineCache pipelines, PipelineCache::create(device));
  ASSIGN_OR_RETURN(Recorder recorder, Recorder::create(device));
  return LongPasses(pool, std::move(pipelines), std::move(recorder));
}

absl::Status LongPasses::submit(std::span<const uint32_t> spirv, double cost,
                                const std::function<absl::Status()>& record) {
  CHECK(cost > 0);
  checkpoint();
  RETURN_IF_ERROR(recorder_.begin());
  RETURN_IF_ERROR(record());
  recorder_.barrier_to_host();
  const auto begin = std::chrono::steady_clock::now();
  RETURN_IF_ERROR(recorder_.submit_and_wait());
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  pace_.learn(spirv.data(), cost, seconds);
  return absl::OkStatus();
}

absl::Status LongPasses::run(const LongPass& pass, void* params, uint32_t params_bytes,
                             shader::PassRange& range) {
  ASSIGN_OR_RETURN(const VkPipeline pipeline, pipelines_.get(pass.spirv, pass.constants));
  CHECK(pass.target_offset + pass.invocations * pass.invocation_bytes <= pass.target->bytes());
  constexpr uint64_t kGroup = shader::ENVIRONMENT_GROUP;
  const uint64_t most = std::min(kMaxGroups * kGroup, PipelineCache::kMaxWriteBytes / pass.invocation_bytes);
  for (uint64_t first = 0; first < pass.invocations;) {
    const auto groups = static_cast<uint64_t>(pace_.affordable(pass.spirv.data()) / (pass.cost * kGroup));
    const uint64_t count =
        std::min({std::max<uint64_t>(groups, 1) * kGroup, most / kGroup * kGroup, pass.invocations - first});
    const auto record = [&]() -> absl::Status {
      range = {static_cast<uint32_t>(first), static_cast<uint32_t>(count)};
      const VkDescriptorBufferInfo written = {pass.target->handle(),
                                              pass.target_offset + first * pass.invocation_bytes,
                                              count * pass.invocation_bytes};
      recorder_.bind(pipeline, pipelines_.layout(), pass.reads, written, params, params_bytes);
      recorder_.dispatch(0, 0, static_cast<uint32_t>((count + kGroup - 1) / kGroup), 1);
      return absl::OkStatus();
    };
    const double cost = pass.cost * static_cast<double>(count);
    RETURN_IF_ERROR(submit(pass.spirv, cost, record));
    first += count;
  }
  return absl::OkStatus();
}

absl::Status LongPasses::run(const Steps& steps) {
  for (uint32_t begin = 0; begin < steps.count;) {
    const double most = pace_.affordable(steps.spirv.data());
    double cost = steps.cost(begin);
    uint32_t end = begin + 1;
    while (end < steps.count && end - begin < steps.most && cost + steps.cost(end) <= most) {
      cost += steps.cost(end++);
    }
    const auto record = [&] { return steps.record(begin, end); };
    RETURN_IF_ERROR(submit(steps.spirv, cost, record));
    begin = end;
  }
  return absl::OkStatus();
}

absl::StatusOr<TexturePool::Lease> LongPasses::take(uint64_t bytes, MemoryUse use) {
  return pool_->take({static_cast<uint32_t>((bytes + 15) / 16), 1, 16, use});
}

absl::StatusOr<TexturePool::Lease> LongPasses::upload(std::span<const std::byte> bytes) {
  ASSIGN_OR_RETURN(TexturePool::Lease lease, take(bytes.size()));
  if (lease.buffer().mapped() != nullptr) {
    std::memcpy(lease.buffer().mapped(), bytes.data(), bytes.size());
    return lease;
  }
  ASSIGN_OR_RETURN(const TexturePool::Lease staged, take(bytes.size(), MemoryUse::kUpload));
  std::memcpy(staged.buffer().mapped(), bytes.data(), bytes.size());
  RETURN_IF_ERROR(copy(staged.buffer(), lease.buffer()));
  return lease;
}

absl::Status LongPasses::copy(const Buffer& from, const Buffer& to) {
  checkpoint();
  RETURN_IF_ERROR(recorder_.begin());
  recorder_.copy(from, to, std::min(from.bytes(), to.bytes()));
  recorder_.barrier_to_host();
  return recorder_.submit_and_wait();
}

uint64_t LongPasses::staging_bytes(uint64_t bytes) { return std::min(bytes, kReadBytes); }

absl::Status LongPasses::read(const Buffer& from, uint64_t offset, std::span<std::byte> to) {
  CHECK(offset + to.size() <= from.bytes());
  if (from.mapped() != nullptr) {
    std::memcpy(to.data(), from.mapped() + offset, to.size());
    return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(const TexturePool::Lease staged, take(staging_bytes(to.size()), MemoryUse::kReadback));
  for (uint64_t first = 0; first < to.size(); first += kReadBytes) {
    checkpoint();
    const uint64_t part = std::min<uint64_t>(kReadBytes, to.size() - first);
    RETURN_IF_ERROR(recorder_.begin());
    recorder_.copy_from(from, offset + first, staged.buffer(), part);
    recorder_.barrier_to_host();
    RETURN_IF_ERROR(recorder_.submit_and_wait());
    std::memcpy(to.data() + first, staged.buffer().mapped(), part);
  }
  return absl::OkStatus();
}

namespace {

constexpr uint32_t kPanoramaTexelBytes = 8;

absl::Status check_sizes(const FrameDesc& desc, uint64_t largest, uint64_t bytes,
                         uint64_t max_allocation_bytes, uint64_t budget_bytes) {
  if (largest > max_allocation_bytes) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a %dx%d %s panorama needs a texture of %d bytes and this device allocates at most %d at once; send "
        "fewer pixels",
        desc.width, desc.height, v1::word_of(desc.format), largest, max_allocation_bytes));
  }
  if (bytes > budget_bytes) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a %dx%d %s panorama needs %d bytes of textures while it arrives and the memory budget is %d; send "
        "fewer pixels or raise --memory-budget",
        desc.width, desc.height, v1::word_of(desc.format), bytes, budget_bytes));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<PanoramaUpload> PanoramaUpload::take(TexturePool& pool, const DeviceSummary& device,
                                                    const FrameDesc& desc) {
  if (desc.width == 0 || desc.height == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("panorama is %dx%d pixels; both sides must be at least 1", desc.width, desc.height));
  }
  PanoramaUpload upload;
  upload.desc_ = desc;
  upload.pitch_ = groups(desc.width, shader::GROUP_TEXELS) * shader::GROUP_TEXELS;
  TextureKey wire = {upload.pitch_, desc.height, bytes_per_pixel(desc.format)};
  const TextureKey panorama = {upload.pitch_, desc.height, kPanoramaTexelBytes};
  const uint64_t bytes = wire.bytes() * (device.unified_memory ? 1 : 2) + panorama.bytes();
  RETURN_IF_ERROR(check_sizes(desc, std::max(wire.bytes(), panorama.bytes()), bytes,
                              device.max_allocation_bytes, pool.budget_bytes()));
  const auto take_one = [&](const TextureKey& key, TexturePool::Lease* lease) {
    absl::StatusOr<TexturePool::Lease> taken =
        pool.take(key, upload.panorama_.bytes() + upload.wire_.bytes());
    if (taken.ok()) *lease = *std::move(taken);
    return taken.status();
  };
  RETURN_IF_ERROR(take_one(panorama, &upload.panorama_));
  RETURN_IF_ERROR(take_one(wire, &upload.wire_));
  if (device.unified_memory) return upload;
  wire.use = MemoryUse::kUpload;
  RETURN_IF_ERROR(take_one(wire, &upload.staged_));
  return upload;
}

std::span<std::byte> PanoramaUpload::row(uint32_t y) {
  CHECK(y < desc_.height);
  const Buffer& host = staged_ ? staged_.buffer() : wire_.buffer();
  const uint64_t pitch_bytes = uint64_t{pitch_} * bytes_per_pixel(desc_.format);
  return {host.mapped() + y * pitch_bytes, desc_.row_bytes()};
}

uint64_t PanoramaUpload::bytes() const { return wire_.bytes() + staged_.bytes() + panorama_.bytes(); }

namespace {

// What an invocation costs, in look-ups of P.
constexpr double kPanoramaCost = 2.0;
constexpr double kDownCost = 2.0;
constexpr double kShTexelCost = 0.5;
constexpr double kBrdfCost = 4.0 * shader::BRDF_POLAR_POINTS * shader::BRDF_ROUND_POINTS;

shader::PanoramaLayout layout_of(const Environment& environment, double rotation_deg) {
  const double turns = rotation_deg / 360 - std::floor(rotation_deg / 360);
  const double texels = turns * environment.width;
  const auto whole = std::min(static_cast<uint32_t>(texels), environment.width - 1);
  return {environment.width, environment.height, environment.pitch, whole,
          static_cast<float>(texels - whole)};
}

template <typename T>
std::span<const std::byte> bytes_of(const std::vector<T>& values) {
  return std::as_bytes(std::span(values));
}

// The size N of a bake, checked.
absl::StatusOr<uint32_t> size_of(const Environment& environment, const BakeSpec& spec) {
  if (spec.size == 0) return default_cube_size(environment.width);
  if (std::has_single_bit(spec.size) && spec.size >= kMinCubeSize && spec.size <= kMaxCubeSize)
    return spec.size;
  return absl::InvalidArgumentError(
      absl::StrFormat("bake.size is %d; it must be a power of two, 16 .. 4096", spec.size));
}

// How many levels of the chain a bake makes. Only specular levels and views read what is below level 0.
// `spec` has its size, here and below.
uint32_t chain_levels_made(const BakeSpec& spec, uint32_t chain_size) {
  const uint32_t all = chain_levels(chain_size);
  return spec.levels == 1 ? all - chain_levels(spec.size) + 1 : all;
}

// How many specular levels it makes behind level 0.
uint32_t specular_levels_made(const BakeSpec& spec) {
  if (spec.quality.specular_detail == 0) return 0;
  const uint32_t all = specular_levels(spec.size);
  return (spec.levels == 0 ? all : std::min(spec.levels, all)) - 1;
}

// About how many texels of the chain a texel reads: those of side s over the sphere, with s^2 = detail^2
// (theta^2 + 4 alpha^2).
double specular_cost(double alpha2, double detail2) { return 100 + 4 / detail2 * std::log(1 + 2.5 / alpha2); }

absl::StatusOr<CubeLevels> take_levels(TexturePool& pool, uint32_t size, uint32_t levels) {
  CHECK(levels > 0 && levels <= chain_levels(size));
  const uint64_t texels = cube_bytes(size, levels) / kCubeTexelBytes;
  ASSIGN_OR_RETURN(TexturePool::Lease lease,
                   pool.take({static_cast<uint32_t>(texels), 1, static_cast<uint32_t>(kCubeTexelBytes)}));
  return CubeLevels{std::move(lease), size, levels};
}

LongPass level_pass(std::span<const uint32_t> spirv, std::vector<VkBufferView> reads,
                    const CubeLevels& levels, uint32_t level, double cost) {
  return {.spirv = spirv,
          .constants = {},
          .reads = std::move(reads),
          .target = &levels.texels.buffer(),
          .target_offset = levels.start(level) * kCubeTexelBytes,
          .invocations = levels.level_texels(level),
          .cost = cost};
}

}  // namespace

EnvironmentBaker::EnvironmentBaker(Device& device, TexturePool& pool, Crew* crew, LongPasses passes)
    : device_(device), pool_(pool), crew_(crew), passes_(std::move(passes)) {}

absl::StatusOr<std::unique_ptr<EnvironmentBaker>> EnvironmentBaker::create(Device& device, TexturePool& pool,
                                                                           Crew* crew) {
  ASSIGN_OR_RETURN(LongPasses passes, LongPasses::create(device, pool));
  return std::unique_ptr<EnvironmentBaker>(new EnvironmentBaker(device, pool, crew, std::move(passes)));
}

absl::StatusOr<PanoramaUpload> EnvironmentBaker::take(const FrameDesc& desc) const {
  return PanoramaUpload::take(pool_, device_.summary(), desc);
}

absl::StatusOr<Environment> EnvironmentBaker::finish(PanoramaUpload upload,
                                                     const std::optional<std::array<float, 9>>& matrix,
                                                     absl::FunctionRef<absl::Status(uint64_t)> grow,
                                                     absl::FunctionRef<bool()> free_one) {
  if (upload.staged_) {
    RETURN_IF_ERROR(passes_.copy(upload.staged_.buffer(), upload.wire_.buffer()));
  }
  ASSIGN_OR_RETURN(const shader::PanoramaCounts found, run_panorama(upload, matrix, /*floats=*/false));
  const bool floats = found.max_scene_bits > std::bit_cast<uint32_t>(shader::MAX_HALF);
  if (floats) {
    const TextureKey key = {upload.pitch_, upload.desc_.height, 4 * sizeof(float)};
    RETURN_IF_ERROR(grow(key.bytes()));
    upload.panorama_ = TexturePool::Lease();
    absl::StatusOr<TexturePool::Lease> larger = pool_.take(key, upload.wire_.bytes());
    while (absl::IsUnavailable(larger.status()) && free_one()) {
      larger = pool_.take(key, upload.wire_.bytes());
    }
    if (!larger.ok()) return larger.status();
    upload.panorama_ = *std::move(larger);
    RETURN_IF_ERROR(run_panorama(upload, matrix, floats).status());
  }
  Environment environment;
  environment.width = upload.desc_.width;
  environment.height = upload.desc_.height;
  environment.pitch = upload.pitch_;
  environment.bad = {found.nan_components,
                     found.infinite_components,
                     found.negative_components,
                     found.clamped_components,
                     {}};
  if (found.first_bad_texel_inverted != 0) environment.bad.first_bad_texel = ~found.first_bad_texel_inverted;
  environment.panorama = std::move(upload.panorama_);
  environment.floats = floats;
  return environment;
}

absl::StatusOr<shader::PanoramaCounts> EnvironmentBaker::run_panorama(
    const PanoramaUpload& upload, const std::optional<std::array<float, 9>>& matrix, bool floats) {
  const shader::PanoramaCounts none{};
  ASSIGN_OR_RETURN(TexturePool::Lease counts, passes_.upload(std::as_bytes(std::span(&none, 1))));
  const FrameDesc& desc = upload.desc_;
  shader::PanoramaParams params{};
  params.frame.width = desc.width;
  params.frame.height = desc.height;
  params.frame.input_pitch = upload.pitch_;
  if (matrix) std::memcpy(&params.frame.m00, matrix->data(), sizeof *matrix);
  params.counts_lo = low(counts.buffer().address());
  params.counts_hi = high(counts.buffer().address());
  const LongPass pass = {
      .spirv = k_panorama_spirv,
      .constants = {static_cast<uint32_t>(desc.format), matrix ? 1u : 0u, floats ? 1u : 0u},
      .reads = {upload.wire_.buffer().view()},
      .target = &upload.panorama_.buffer(),
      .invocations = uint64_t{upload.pitch_} / shader::GROUP_TEXELS * desc.height,
      .invocation_bytes = shader::GROUP_TEXELS * (floats ? 16u : 8u),
      .cost = kPanoramaCost};
  RETURN_IF_ERROR(passes_.run(pass, params));
  shader::PanoramaCounts found{};
  if (absl::Status status = passes_.read(counts.buffer(), 0, std::as_writable_bytes(std::span(&found, 1)));
      !status.ok()) {
    return status;
  }
  return found;
}

absl::StatusOr<Harmonics> EnvironmentBaker::radiance(Environment& environment) {
  if (environment.radiance) return *environment.radiance;
  const uint32_t width = environment.width;
  ASSIGN_OR_RETURN(const TexturePool::Lease columns, passes_.upload(bytes_of(column_factors(width))));
  std::vector<float> sums(size_t{environment.height} * shader::SH_PARTS * 16);
  ASSIGN_OR_RETURN(const TexturePool::Lease parts, passes_.take(sums.size() * sizeof(float)));
  const LongPass pass = {.spirv = k_panorama_sh_spirv,
                         .constants = {environment.floats},
                         .reads = {environment.panorama.buffer().view(), columns.buffer().view()},
                         .target = &parts.buffer(),
                         .invocations = uint64_t{environment.height} * shader::SH_PARTS,
                         .invocation_bytes = 16 * sizeof(float),
                         .cost = kShTexelCost * (2.0 + static_cast<double>(width) / shader::SH_PARTS)};
  shader::PanoramaShParams params{};
  params.panorama = layout_of(environment, 0);
  absl::Status status = passes_.run(pass, params);
  if (status.ok()) status = passes_.read(parts.buffer(), 0, std::as_writable_bytes(std::span(sums)));
  if (!status.ok()) return status;
  environment.radiance = radiance_of(sums, width, environment.height);
  return *environment.radiance;
}

absl::StatusOr<uint64_t> EnvironmentBaker::bake_bytes(const Environment& environment, const BakeSpec& spec,
                                                      uint64_t host_bytes) const {
  const absl::StatusOr<uint32_t> size = size_of(environment, spec);
  if (!size.ok()) return size.status();
  BakeSpec sized = spec;
  sized.size = *size;
  const uint32_t chain = std::max(*size, default_cube_size(environment.width));
  const uint64_t largest = cube_bytes(chain, chain_levels_made(sized, chain));
  uint64_t bytes = largest;
  if (const uint32_t specular = specular_levels_made(sized); specular > 0) {
    bytes += cube_bytes(*size / 2, specular);
  }
  if (largest > device_.summary().max_allocation_bytes) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "a bake of size %d needs a texture of %d bytes and this device allocates at most %d at once; ask for "
        "a smaller size or for fewer levels",
        *size, largest, device_.summary().max_allocation_bytes));
  }
  bytes += host_bytes;
  if (!device_.unified_memory()) {  // read_face() and read_panorama() copy while the bake has its textures
    const uint64_t face = cube_bytes(*size, 1) / kCubeFaces;
    bytes += LongPasses::staging_bytes(std::max(face, environment.panorama.bytes()));
  }
  if (bytes > pool_.budget_bytes()) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("a bake of size %d needs %d bytes and the server's memory budget is %d; ask for a "
                        "smaller size, for fewer "
                        "levels, or raise candelad's --memory-budget",
                        *size, bytes, pool_.budget_bytes()));
  }
  return bytes;
}

absl::StatusOr<BakedCube> EnvironmentBaker::bake(const Environment& environment, const BakeSpec& spec) {
  if (absl::StatusOr<uint64_t> bytes = bake_bytes(environment, spec); !bytes.ok()) return bytes.status();
  BakedCube cube;
  cube.spec = spec;
  cube.spec.size = *size_of(environment, spec);
  const uint32_t chain_size = std::max(cube.spec.size, default_cube_size(environment.width));
  ASSIGN_OR_RETURN(cube.chain, take_levels(pool_, chain_size, chain_levels_made(cube.spec, chain_size)));
  cube.first = chain_levels(chain_size) - chain_levels(cube.spec.size);
  CHECK(cube.first < cube.chain.levels && cube.chain.size_of(cube.first) == cube.spec.size);
  absl::Status status = make_level_0(environment, cube.spec, cube.chain);
  if (status.ok()) status = make_chain(cube.chain);
  if (!status.ok()) return status;
  ASSIGN_OR_RETURN(cube.specular, make_specular(cube.spec, cube.chain));
  return cube;
}

absl::Status EnvironmentBaker::make_level_0(const Environment& environment, const BakeSpec& spec,
                                            CubeLevels& chain) {
  shader::CubeFaceParams params{};
  params.panorama = layout_of(environment, spec.rotation_deg);
  params.size = chain.size;
  params.samples = cube_samples(environment.width, chain.size, spec.quality.cube_samples);
  const double cost = static_cast<double>(params.samples) * params.samples;
  LongPass pass = level_pass(k_cube_face_spirv, {environment.panorama.buffer().view()}, chain, 0, cost);
  pass.constants = {environment.floats};
  return passes_.run(pass, params);
}

absl::Status EnvironmentBaker::make_chain(CubeLevels& chain) {
  for (uint32_t level = 1; level < chain.levels; ++level) {
    shader::CubeDownParams params{};
    params.size = chain.size_of(level);
    params.from = static_cast<uint32_t>(chain.start(level - 1));
    const LongPass pass =
        level_pass(k_cube_down_spirv, {chain.texels.buffer().view()}, chain, level, kDownCost);
    RETURN_IF_ERROR(passes_.run(pass, params));
  }
  return absl::OkStatus();
}

absl::StatusOr<CubeLevels> EnvironmentBaker::make_specular(const BakeSpec& spec, const CubeLevels& chain) {
  const uint32_t levels = specular_levels_made(spec);
  if (levels == 0) return CubeLevels{};
  ASSIGN_OR_RETURN(CubeLevels specular, take_levels(pool_, spec.size / 2, levels));
  const double detail2 = spec.quality.specular_detail * spec.quality.specular_detail;
  for (uint32_t level = 0; level < levels; ++level) {
    const double roughness = specular_roughness(level + 1, specular_levels(spec.size), spec.mapping);
    const double alpha2 = std::pow(roughness, 4);
    shader::CubeSpecularParams params{};
    params.size = specular.size_of(level);
    params.chain_size = chain.size;
    params.chain_last = chain.levels - 1;
    params.alpha2 = static_cast<float>(alpha2);
    params.detail2 = static_cast<float>(detail2);
    const LongPass pass = level_pass(k_cube_specular_spirv, {chain.texels.buffer().view()}, specular, level,
                                     specular_cost(alpha2, detail2));
    RETURN_IF_ERROR(passes_.run(pass, params));
  }
  return specular;
}

absl::StatusOr<std::span<const uint16_t>> EnvironmentBaker::brdf_table() {
  if (!brdf_.empty()) return brdf_;
  const uint64_t texels = uint64_t{shader::BRDF_SIZE} * shader::BRDF_SIZE / 4;
  ASSIGN_OR_RETURN(TexturePool::Lease lease, passes_.take(texels * 16));
  const LongPass pass = {.spirv = k_brdf_table_spirv,
                         .constants = {},
                         .reads = {},
                         .target = &lease.buffer(),
                         .invocations = texels,
                         .cost = kBrdfCost};
  RETURN_IF_ERROR(passes_.run(pass, shader::BrdfTableParams{}));
  std::vector<uint16_t> halves(size_t{2} * shader::BRDF_SIZE * shader::BRDF_SIZE);
  RETURN_IF_ERROR(passes_.read(lease.buffer(), 0, std::as_writable_bytes(std::span(halves))));
  // Another job may have made it meanwhile, and may be reading it.
  if (brdf_.empty()) brdf_ = std::move(halves);
  CHECK(brdf_.size() == size_t{2} * shader::BRDF_SIZE * shader::BRDF_SIZE);
  return brdf_;
}

absl::StatusOr<std::vector<float>> EnvironmentBaker::read_face(const CubeLevels& levels, uint32_t level,
                                                               uint32_t face) {
  CHECK(level < levels.levels && face < kCubeFaces);
  std::vector<std::array<float, 4>> stored(levels.face_texels(level));
  const uint64_t first = levels.start(level) + face * levels.face_texels(level);
  RETURN_IF_ERROR(passes_.read(levels.texels.buffer(), first * kCubeTexelBytes,
                               std::as_writable_bytes(std::span(stored))));
  const uint32_t size = levels.size_of(level);
  std::vector<float> rgb;
  rgb.reserve(size_t{3} * size * size);
  for (uint32_t j = 1; j <= size; ++j) {
    for (uint32_t i = 1; i <= size; ++i) {
      const std::array<float, 4>& texel = stored[size_t{j} * (size + 2) + i];
      rgb.insert(rgb.end(), texel.begin(), texel.begin() + 3);
    }
  }
  return rgb;
}

absl::StatusOr<std::vector<std::array<float, 4>>> EnvironmentBaker::read_panorama(
    const Environment& environment) {
  const uint64_t row_texels = environment.pitch;
  const uint64_t texel_bytes = environment.floats ? 16 : 8;
  std::vector<std::byte> row(row_texels * texel_bytes);
  std::vector<std::array<float, 4>> texels;
  texels.reserve(size_t{environment.width} * environment.height);
  for (uint32_t y = 0; y < environment.height; ++y) {
    RETURN_IF_ERROR(passes_.read(environment.panorama.buffer(), y * row.size(), row));
    for (uint32_t x = 0; x < environment.width; ++x) {
      std::array<float, 4>& texel = texels.emplace_back();
      if (environment.floats) {
        std::memcpy(texel.data(), &row[x * texel_bytes], sizeof texel);
        continue;
      }
      std::array<uint16_t, 4> halves;
      std::memcpy(halves.data(), &row[x * texel_bytes], sizeof halves);
      for (size_t c = 0; c < 4; ++c) texel[c] = imath_half_to_float(halves[c]);
    }
  }
  return texels;
}

// The views of EnvironmentBaker.

static_assert(sizeof(shader::ViewParams) <= PipelineCache::kPushBytes);

namespace {

// In look-ups. A thread of the host does so many in 10 to 25 ms, and the software device in 50.
constexpr double kMostAtOnce = 1e7;

}  // namespace

absl::Status EnvironmentBaker::prepare_view(Environment& environment, const BakeQuality& quality,
                                            bool objects) {
  if (objects) {
    RETURN_IF_ERROR(brdf_table().status());
  }
  BakedCube& view = environment.view;
  const BakeQuality sky = {quality.cube_samples, 0.0};
  if (!view.chain || (view.spec.quality != quality && view.spec.quality != sky)) {
    view = {};
    ASSIGN_OR_RETURN(view, bake(environment, {.size = view_cube_size(environment.width),
                                              .mapping = RoughnessMapping::kPerceptual,
                                              .quality = objects ? quality : sky}));
  }
  if (!objects || view.spec.quality == quality) return absl::OkStatus();
  BakeSpec spec = view.spec;
  spec.quality = quality;
  ASSIGN_OR_RETURN(view.specular, make_specular(spec, view.chain));
  view.spec = spec;
  return absl::OkStatus();
}

absl::Status EnvironmentBaker::render_view(Environment& environment, const View& view, FrameMemory& memory) {
  RETURN_IF_ERROR(check_view(view));
  const bool with_objects = !view.objects.empty();
  if (!environment.view.chain || (with_objects && environment.view.spec.quality.specular_detail == 0.0)) {
    return absl::FailedPreconditionError("the environment has no levels for this view");
  }
  if (const v1::PixelFormat format = view_format(environment); memory.desc().format != format) {
    return absl::InvalidArgumentError(
        absl::StrCat("a view of this environment is a frame of ", v1::word_of(format)));
  }
  CHECK(memory.textures().stage != FrameStage::kOutputOnly);
  ASSIGN_OR_RETURN(const Harmonics light, radiance(environment));
  absl::StatusOr<std::span<const uint16_t>> brdf = std::span<const uint16_t>();
  if (with_objects) brdf = brdf_table();
  if (!brdf.ok()) return brdf.status();
  const std::vector<shader::ViewObject> objects = view_objects(view, environment.view.specular, *brdf);
  const shader::ViewLight irradiance = view_light(irradiance_of(light));
  if (crew_ != nullptr) {
    if (device_.lost()) {
      return absl::UnavailableError(absl::StrCat("Vulkan device lost: ", device_.summary().name));
    }
    draw_on_host(environment.view, environment.floats, view, irradiance, objects, memory, *crew_);
    return absl::OkStatus();
  }
  ASSIGN_OR_RETURN(const TexturePool::Lease scene, passes_.upload(view_scene(irradiance, objects)));
  absl::Status status = draw_view(environment, view, objects, scene.buffer(), memory);
  const FrameTextures& textures = memory.textures();
  if (!status.ok() || !textures.upload) return status;
  // Whoever renders the frame takes its pixels from here, like those of the wire.
  return passes_.copy(textures.input.buffer(), textures.upload.buffer());
}

bool EnvironmentBaker::takes_long(const View& view, const FrameDesc& desc) {
  return most_cost_of_row(view, desc.width) * desc.height / shader::VIEW_TILE > kMostAtOnce;
}

absl::Status EnvironmentBaker::draw_view(const Environment& environment, const View& view,
                                         std::span<const shader::ViewObject> objects, const Buffer& scene,
                                         FrameMemory& memory) {
  const TextureLayout& layout = memory.textures().layout;
  const Buffer& input = memory.textures().input.buffer();
  shader::ViewParams params =
      view_params(view, layout.desc.width, layout.desc.height, layout.pitch, environment.view.chain.size);
  const VkBufferView chain = environment.view.chain.texels.buffer().view();
  const CubeLevels& specular = environment.view.specular;
  // Without specular levels nothing reads them, but the binding still has to hold something.
  const VkBufferView reads[] = {chain, specular ? specular.texels.buffer().view() : chain, scene.view()};
  const ViewTiles tiles(view, params, objects);
  std::vector<std::vector<ViewRun>> rows;
  for (uint32_t y = 0; y < tiles.rows(); ++y) rows.push_back(tiles.row(y));
  const uint64_t row_bytes = uint64_t{layout.pitch} * bytes_per_pixel(layout.desc.format);
  const auto record = [&](uint32_t begin, uint32_t end) -> absl::Status {
    params.first_row = begin * shader::VIEW_TILE;
    const uint32_t last = std::min(end * shader::VIEW_TILE, layout.desc.height);
    const VkDescriptorBufferInfo written = {input.handle(), params.first_row * row_bytes,
                                            (last - params.first_row) * row_bytes};
    bool over_sky = false;
    for (const auto& [kind, boxes] : boxes_of(std::span(rows).subspan(begin, end - begin), begin)) {
      ASSIGN_OR_RETURN(const VkPipeline pipeline,
                       passes_.pipelines().get(k_view_spirv, constants_of(kind, view, environment.floats)));
      if (kind.objects && !std::exchange(over_sky, true)) passes_.recorder().barrier();
      params.first_object = kind.first_object;
      params.end_object = kind.end_object;
      passes_.recorder().bind(pipeline, passes_.pipelines().layout(), reads, written, &params, sizeof params);
      for (const Box& box : boxes) passes_.recorder().dispatch(box.x0, box.y0, box.x1, box.y1);
    }
    return absl::OkStatus();
  };
  return passes_.run(
      {.spirv = k_view_spirv,
       .count = static_cast<uint32_t>(rows.size()),
       .cost = [&](uint32_t y) { return cost_of(rows[y], view); },
       .record = record,
       .most = static_cast<uint32_t>(PipelineCache::kMaxWriteBytes / row_bytes / shader::VIEW_TILE)});
}

}  // namespace candela
