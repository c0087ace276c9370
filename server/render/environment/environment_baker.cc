#include "server/render/environment/environment_baker.h"

#include <half.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"
#include "shaders/brdf_table.spv.h"
#include "shaders/cube_down.spv.h"
#include "shaders/cube_face.spv.h"
#include "shaders/cube_specular.spv.h"
#include "shaders/panorama.spv.h"
#include "shaders/panorama_sh.spv.h"

namespace candela {

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

}  // namespace candela
