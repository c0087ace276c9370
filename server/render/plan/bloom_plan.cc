#include "server/render/plan/bloom_plan.h"

#include <bit>
#include <cmath>
#include <span>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/render/color/portable_math.h"

namespace candela {

namespace {

// A device may flush the square of a smaller knee to 0, and would then divide 0 by 0.
constexpr float kMinKnee = 1e-15f;

// A margin for the rounding errors of a mean and of the value subtracted from it: at most 8 of 2^-24 each.
constexpr float kRoundings = 0x1p-20f;

// If no light of the frame is above this, no texel of bloom level 0 gets any.
float bright_bound(const v1::Bloom& bloom, float threshold) {
  if (bloom.kind() == v1::Bloom::KIND_CONSERVE) return -1.0f;  // conserving bloom takes light from everywhere
  const float knee = bloom.kind() == v1::Bloom::KIND_MIP ? bloom.softness() * threshold : 0.0f;
  return threshold - knee - kRoundings * threshold;
}

// The parts of the frame with light that may pass the bright pass.
Area bright_area(const v1::Bloom& bloom, const FrameStats& stats, const FrameDesc& desc, float threshold) {
  return lit_area(stats.tile_light, desc.width, desc.height, bright_bound(bloom, threshold));
}

uint64_t texels_of(const std::vector<Box>& boxes) {
  uint64_t texels = 0;
  for (const Box& box : boxes) texels += uint64_t{box.x1 - box.x0} * (box.y1 - box.y0);
  return texels;
}

// Tells people where the light is.
std::string light_words(const FrameDesc& desc, const std::vector<Box>& lit) {
  const double part = static_cast<double>(texels_of(lit)) / (static_cast<double>(desc.width) * desc.height);
  return part < 1 ? absl::StrFormat("light in %.2g %% of the frame's tiles", 100 * part)
                  : "light in all tiles of the frame";
}

// The texels of the level that a pass writes where light may be after it.
Area lit_after(Pass pass, uint32_t written, const TextureLayout& layout, std::span<const Box> lit) {
  const std::vector<LevelSize>& sizes = layout.level_sizes;
  Area area = in_level({lit.begin(), lit.end()}, layout.level_size);
  if (pass == Pass::kBrightPass) return area;
  if (pass == Pass::kGaussian) {
    area = after_gaussian(area, sizes[1], 0, shader::GAUSSIAN_REACH);
    return written == 1 ? area : after_gaussian(area, sizes[0], shader::GAUSSIAN_REACH, 0);
  }
  const bool up = pass == Pass::kBloomUp;
  const auto last = static_cast<uint32_t>(up ? sizes.size() - 1 : written);
  for (uint32_t level = 1; level <= last; ++level) area = after_bloom_down(area, sizes[level]);
  for (uint32_t level = last; up && level-- > written;) area = after_bloom_up(area, sizes[level]);
  return area;
}

// A step. Each of its work groups writes `width` x `height` texels. If they are not the whole level, a pass
// that does not work in place clears it first.
BloomStep step_of(Pass pass, uint32_t level, const TextureLayout& layout, std::span<const Box> lit,
                  uint32_t width, uint32_t height) {
  const LevelSize& size = layout.level_sizes[level];
  Cover work = cover(lit_after(pass, level, layout, lit), width, height, groups(size.width, width),
                     groups(size.height, height));
  // What it leaves out keeps what it holds already: the light of its own level, or zeros.
  const bool in_place = pass == Pass::kBloomUp || (pass == Pass::kGaussian && level == 0);
  BloomStep step;
  step.pass = pass;
  step.level = level;
  step.group_rows = height;
  step.group_columns = width;
  step.clear_first = !work.whole() && !in_place;
  step.groups = std::move(work.groups);
  return step;
}

BloomStep bright_pass(const TextureLayout& layout, const v1::Bloom& bloom, float threshold, bool scrub,
                      const std::optional<reference::Matrix>& matrix, std::span<const Box> lit) {
  constexpr uint32_t kWidth = shader::GROUP_TEXELS * shader::BRIGHT_GROUP_X * shader::BRIGHT_STEPS;
  constexpr uint32_t kHeight = shader::BRIGHT_ROWS * shader::BRIGHT_GROUP_Y;
  const uint32_t size = layout.level_size;
  BloomStep step = step_of(Pass::kBrightPass, 0, layout, lit, kWidth / size, kHeight / size);
  const float knee = bloom.softness() * bloom.threshold();
  step.inputs = ShaderInputs<shader::BrightPassConstants, shader::BrightPassParams>{
      .constants = {.pixels = static_cast<uint32_t>(layout.desc.format),
                    .matrix = matrix.has_value(),
                    .scrub = scrub,
                    .bloom = static_cast<uint32_t>(bloom.kind()),
                    .firefly_weights = bloom.firefly_weights(),
                    .level_size = size,
                    .whole = layout.desc.width % shader::GROUP_TEXELS == 0},
      .params = {.frame = input_params(layout, matrix),
                 .first_row = 0,
                 .level_width = layout.level_sizes[0].width,
                 .threshold = threshold,
                 .knee = knee < kMinKnee ? 0.0f : knee}};
  return step;
}

shader::BloomLevelParams level_params(const TextureLayout& layout, uint32_t from, uint32_t to) {
  const std::vector<LevelSize>& sizes = layout.level_sizes;
  return {.first_row = 0,
          .from_width = sizes[from].width,
          .from_height = sizes[from].height,
          .to_width = sizes[to].width,
          .to_height = sizes[to].height};
}

// An invocation of these writes 1 and 2 columns.
BloomStep bloom_down(const TextureLayout& layout, uint32_t level, std::span<const Box> lit) {
  BloomStep step = step_of(Pass::kBloomDown, level, layout, lit, shader::BLOOM_GROUP_X,
                           shader::BLOOM_ROWS * shader::BLOOM_GROUP_Y);
  step.from_level = level - 1;
  step.inputs = ShaderInputs<shader::BloomDownConstants, shader::BloomLevelParams>{
      .constants = {}, .params = level_params(layout, level - 1, level)};
  return step;
}

BloomStep bloom_up(const TextureLayout& layout, uint32_t level, std::span<const Box> lit) {
  BloomStep step = step_of(Pass::kBloomUp, level, layout, lit, 2 * shader::BLOOM_GROUP_X,
                           2 * shader::BLOOM_ROWS * shader::BLOOM_GROUP_Y);
  step.from_level = level + 1;
  step.inputs = ShaderInputs<shader::BloomUpConstants, shader::BloomLevelParams>{
      .constants = {.fine_weight = level == 0 && layout.first_level_twice ? 2.0f : 1.0f},
      .params = level_params(layout, level + 1, level)};
  return step;
}

// The vertical pass writes level 1 from level 0. The horizontal pass writes level 0 from level 1.
BloomStep gaussian(const TextureLayout& layout, uint32_t level, std::span<const Box> lit) {
  BloomStep step = step_of(Pass::kGaussian, level, layout, lit, shader::BLOOM_GROUP_X,
                           shader::BLOOM_ROWS * shader::BLOOM_GROUP_Y);
  step.from_level = 1 - level;
  const LevelSize& size = layout.level_sizes[level];
  step.inputs = ShaderInputs<shader::GaussianConstants, shader::GaussianParams>{
      .constants = {.vertical = level},
      .params = {.first_row = 0, .width = size.width, .height = size.height}};
  return step;
}

std::string gaussian_words(const TextureLayout& layout, const v1::Bloom& bloom, float threshold,
                           const std::vector<Box>& lit) {
  const LevelSize& size = layout.level_sizes[0];
  return absl::StrFormat("gaussian bloom at %dx%d: threshold %g, %g times the mean; %s", size.width,
                         size.height, threshold, bloom.threshold(), light_words(layout.desc, lit));
}

std::string mip_words(const TextureLayout& layout, const v1::Bloom& bloom, const std::vector<Box>& lit) {
  const std::vector<LevelSize>& sizes = layout.level_sizes;
  const auto count = static_cast<uint32_t>(sizes.size());
  const bool left_out = layout.level_size != kWholeBloom && bloom.levels() > 1;
  return absl::StrFormat("bloom over %d level%s from %dx%d to %dx%d: %s%s", count, count == 1 ? "" : "s",
                         sizes.front().width, sizes.front().height, sizes.back().width, sizes.back().height,
                         bloom.kind() == v1::Bloom::KIND_CONSERVE
                             ? absl::StrFormat("%g of the scene's light", bloom.intensity())
                             : light_words(layout.desc, lit),
                         count + left_out < bloom.levels() ? "; the frame is too small for more levels" : "");
}

}  // namespace

shader::InputParams input_params(const TextureLayout& layout,
                                 const std::optional<reference::Matrix>& matrix) {
  const reference::Matrix m = matrix.value_or(reference::Matrix{1, 0, 0, 0, 1, 0, 0, 0, 1});
  return {.width = layout.desc.width,
          .height = layout.desc.height,
          .input_pitch = layout.pitch,
          .m00 = m[0],
          .m01 = m[1],
          .m02 = m[2],
          .m10 = m[3],
          .m11 = m[4],
          .m12 = m[5],
          .m20 = m[6],
          .m21 = m[7],
          .m22 = m[8]};
}

float bright_threshold(const v1::Bloom& bloom, const FrameStats& stats) {
  if (bloom.kind() != v1::Bloom::KIND_GAUSSIAN) return bloom.threshold();
  return static_cast<float>(bloom.threshold() * portable_exp2(stats.mean_log2_luminance));
}

bool may_bloom(const v1::Bloom& bloom, const FrameStats& stats, const FrameDesc& desc, double mean_error) {
  if (bloom.intensity() == 0) return false;
  float threshold = bright_threshold(bloom, stats);
  // Its threshold is a multiple of the mean, and falls with it.
  if (bloom.kind() == v1::Bloom::KIND_GAUSSIAN) threshold *= static_cast<float>(portable_exp2(-mean_error));
  return !bright_area(bloom, stats, desc, threshold).empty();
}

void plan_bloom(const TextureLayout& layout, const Metered& metered, const v1::Bloom& bloom,
                const std::optional<reference::Matrix>& matrix, Plan& plan) {
  if (bloom.intensity() == 0) {
    plan.words.push_back("no bloom: its intensity is 0");
    return;
  }
  const FrameStats& stats = metered.stats;
  const bool blurs = bloom.kind() == v1::Bloom::KIND_GAUSSIAN;
  const float threshold = bright_threshold(bloom, stats);
  plan.lit = bright_area(bloom, stats, layout.desc, threshold);
  if (plan.lit.empty()) {
    plan.words.push_back(absl::StrFormat(
        "no bloom: nothing passes the threshold %g%s (the brightest is %g)", threshold,
        blurs ? absl::StrFormat(", %g times the mean", bloom.threshold()) : "", stats.max_luminance));
    return;
  }
  plan.bloom_steps.push_back(bright_pass(layout, bloom, threshold, metered.scrubbed, matrix, plan.lit));
  if (blurs) {
    plan.bloom_steps.push_back(gaussian(layout, 1, plan.lit));
    plan.bloom_steps.push_back(gaussian(layout, 0, plan.lit));
    plan.words.push_back(gaussian_words(layout, bloom, threshold, plan.lit));
    return;
  }
  const auto count = static_cast<uint32_t>(layout.level_sizes.size());
  for (uint32_t level = 1; level < count; ++level) {
    plan.bloom_steps.push_back(bloom_down(layout, level, plan.lit));
  }
  for (uint32_t level = count - 1; level-- > 0;) {
    plan.bloom_steps.push_back(bloom_up(layout, level, plan.lit));
  }
  plan.words.push_back(mip_words(layout, bloom, plan.lit));
}

Area bloom_reach(const TextureLayout& layout, const Plan& plan) {
  if (!plan.bloom()) return {};
  const FrameDesc& desc = layout.desc;
  const Pass last = plan.bloom_steps.back().pass == Pass::kGaussian ? Pass::kGaussian : Pass::kBloomUp;
  return in_frame(lit_after(last, 0, layout, plan.lit), layout.level_size, desc.width, desc.height);
}

}  // namespace candela
