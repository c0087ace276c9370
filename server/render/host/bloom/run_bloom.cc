#include "server/render/host/bloom/run_bloom.h"

#include <algorithm>
#include <cstring>
#include <variant>

#include "server/base/check.h"
#include "server/render/host/bloom/bloom_passes.h"

namespace candela::host {

namespace {

// Texels that are worth waking a thread for, and parts for each thread, so that all end at about the same
// time. A slice ends between two parts, so none takes more than a few milliseconds.
constexpr uint64_t kTexelsOfPart = 4096;
constexpr uint64_t kMostTexelsOfPart = uint64_t{1} << 17;
constexpr uint64_t kPartsPerThread = 4;

// The boxes of a level that a step's work groups cover, in parts for `threads` threads.
std::vector<Box> parts_of(const BloomStep& step, const LevelPlanes& to, uint32_t threads) {
  std::vector<Box> boxes;
  uint64_t texels = 0;
  for (const Box& group : step.groups) {
    const Box box = {group.x0 * step.group_columns, group.y0 * step.group_rows,
                     std::min(group.x1 * step.group_columns, to.width),
                     std::min(group.y1 * step.group_rows, to.height)};
    CHECK(box.x0 < box.x1 && box.y0 < box.y1);
    boxes.push_back(box);
    texels += uint64_t{box.x1 - box.x0} * (box.y1 - box.y0);
  }
  const uint64_t part_texels =
      std::clamp(texels / (kPartsPerThread * threads), kTexelsOfPart, kMostTexelsOfPart);
  std::vector<Box> parts;
  for (const Box& box : boxes) {
    const auto rows = static_cast<uint32_t>(std::max<uint64_t>(1, part_texels / (box.x1 - box.x0)));
    for (uint32_t y = box.y0; y < box.y1; y += rows) {
      parts.push_back({box.x0, y, box.x1, std::min(y + rows, box.y1)});
    }
  }
  return parts;
}

using BrightInputs = ShaderInputs<shader::BrightPassConstants, shader::BrightPassParams>;
using UpInputs = ShaderInputs<shader::BloomUpConstants, shader::BloomLevelParams>;
using GaussianInputs = ShaderInputs<shader::GaussianConstants, shader::GaussianParams>;

void make_part(const BloomStep& step, const FrameTextures& textures, const LevelPlanes& to, const Box& part) {
  if (const auto* bright = std::get_if<BrightInputs>(&step.inputs)) {
    return bright_pass({bright->constants, bright->params, textures.input.buffer().mapped()}, to, part);
  }
  const LevelPlanes from = level_planes(textures, step.from_level);
  if (const auto* up = std::get_if<UpInputs>(&step.inputs)) {
    return bloom_up(from, to, up->constants.fine_weight, part);
  }
  if (const auto* blur = std::get_if<GaussianInputs>(&step.inputs)) {
    return gaussian(from, to, blur->constants.vertical != 0, part);
  }
  bloom_down(from, to, part);
}

// A large level is cleared by several threads: one alone cannot use all of the memory's speed.
void clear(const LevelPlanes& level, Crew& crew) {
  constexpr size_t kFloatsOfPart = size_t{1} << 17;
  const size_t row = 3 * level.stride();
  const auto rows = static_cast<uint32_t>(std::max<size_t>(1, kFloatsOfPart / row));
  crew.run(groups(level.height, rows), [&](uint32_t i) {
    const size_t count = std::min(rows, level.height - i * rows);
    std::memset(level.row(size_t{i} * rows, 0), 0, count * row * sizeof(float));
  });
}

}  // namespace

LevelPlanes level_planes(const FrameTextures& textures, size_t level) {
  CHECK(level < textures.layout.level_sizes.size());
  const LevelSize& size = textures.layout.level_sizes[level];
  CHECK(uint64_t{size.width} * size.height * 4 * sizeof(float) <= textures.levels[level].bytes());
  return {reinterpret_cast<float*>(textures.levels[level].buffer().mapped()), size.width, size.height};
}

void run_bloom(const BloomStep& step, const FrameTextures& textures, Crew& crew) {
  const LevelPlanes to = level_planes(textures, step.level);
  if (step.clear_first) clear(to, crew);
  const std::vector<Box> parts = parts_of(step, to, crew.threads());
  crew.run(static_cast<uint32_t>(parts.size()), [&](uint32_t i) { make_part(step, textures, to, parts[i]); });
}

}  // namespace candela::host
