#include "server/render/plan/plan.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/render/plan/lit_area.h"
#include "shaders/params.h"

namespace candela {

std::vector<LevelSize> bloom_level_sizes(uint32_t width, uint32_t height, uint32_t levels,
                                         uint32_t level_size) {
  std::vector<LevelSize> sizes = {{(width + 1) / 2, (height + 1) / 2}};
  while (sizes.size() < levels) {
    const LevelSize next = {(sizes.back().width + 1) / 2, (sizes.back().height + 1) / 2};
    if (std::min(next.width, next.height) < 2) break;
    sizes.push_back(next);
  }
  if (level_size == 2) return sizes;
  if (sizes.size() == 1) return {{(width + 3) / 4, (height + 3) / 4}};
  return {sizes.begin() + 1, sizes.end()};
}

std::vector<LevelSize> gaussian_level_sizes(uint32_t width, uint32_t height) {
  return {2, {(width + 3) / 4, (height + 3) / 4}};
}

float bright_threshold(const BloomSettings& bloom, const FrameStats& stats) {
  if (bloom.kind != BloomKind::kGaussian) return bloom.threshold;
  return static_cast<float>(bloom.threshold * std::exp2(stats.mean_log2_luminance));
}

const char* name(Pass pass) {
  switch (pass) {
    case Pass::kIngest:
      return "ingest";
    case Pass::kBrightPass:
      return "bright_pass";
    case Pass::kBloomDown:
      return "bloom_down";
    case Pass::kBloomUp:
      return "bloom_up";
    case Pass::kGaussian:
      return "gaussian";
    case Pass::kResolve:
      return "resolve";
    case Pass::kReference:
      return "reference";
  }
  return "unknown";
}

namespace {

std::string metering_words(const MeteringSettings& metering) {
  std::string words;
  if (metering.statistic == MeterStatistic::kPercentile) {
    absl::StrAppendFormat(&words, " between %g %% and %g %%", metering.percentile_low,
                          metering.percentile_high);
  }
  if (metering.weights == MeterWeights::kCenter) words += " around the centre";
  if (metering.weights == MeterWeights::kSpot) {
    absl::StrAppendFormat(&words, " in x %d .. %d, y %d .. %d", metering.spot.x0, metering.spot.x1,
                          metering.spot.y0, metering.spot.y1);
  }
  return words;
}

// Room for the roundings of a mean and of what is taken from it, at most 8 of 2^-24 each.
constexpr float kRoundings = 0x1p-20f;

// No texel of bloom level 0 gets light where no light of the frame is above this.
float bright_bound(const BloomSettings& bloom, float threshold) {
  if (bloom.kind == BloomKind::kConserve) return -1.0f;  // what is conserved is taken from everywhere
  const float knee = bloom.kind == BloomKind::kMip ? bloom.softness * threshold : 0.0f;
  return threshold - knee - kRoundings * threshold;
}

uint64_t texels_of(const std::vector<Box>& boxes) {
  uint64_t texels = 0;
  for (const Box& box : boxes) texels += uint64_t{box.x1 - box.x0} * (box.y1 - box.y0);
  return texels;
}

// Where the light is, for people.
std::string light_words(const FrameDesc& desc, const std::vector<Box>& lit) {
  const double part = static_cast<double>(texels_of(lit)) / (static_cast<double>(desc.width) * desc.height);
  return part < 1 ? absl::StrFormat("light in %.2g %% of the frame's tiles", 100 * part)
                  : "light in all tiles of the frame";
}

// Adds the bloom's steps and words, or the reason why there is none.
void plan_bloom(const FrameDesc& desc, const FrameStats& stats, const BloomSettings& bloom, const Tier& tier,
                Plan& plan) {
  if (bloom.intensity == 0) {
    plan.words.push_back("no bloom: its intensity is 0");
    return;
  }
  const bool gaussian = bloom.kind == BloomKind::kGaussian;
  const float threshold = bright_threshold(bloom, stats);
  plan.lit = lit_area(stats.tile_light, desc.width, desc.height, bright_bound(bloom, threshold));
  if (plan.lit.empty()) {
    plan.words.push_back(absl::StrFormat(
        "no bloom: nothing passes the threshold %g%s (the brightest is %g)", threshold,
        gaussian ? absl::StrFormat(", %g times the mean", bloom.threshold) : "", stats.max_luminance));
    return;
  }
  plan.bloom = true;
  plan.steps.push_back({Pass::kBrightPass, 0});
  if (gaussian) {
    plan.steps.push_back({Pass::kGaussian, 1});
    plan.steps.push_back({Pass::kGaussian, 0});
    const LevelSize size = gaussian_level_sizes(desc.width, desc.height)[0];
    plan.words.push_back(absl::StrFormat("gaussian bloom at %dx%d: threshold %g, %g times the mean; %s",
                                         size.width, size.height, threshold, bloom.threshold,
                                         light_words(desc, plan.lit)));
    return;
  }
  const std::vector<LevelSize> sizes =
      bloom_level_sizes(desc.width, desc.height, bloom.levels, tier.bloom_level_size);
  const auto count = static_cast<uint32_t>(sizes.size());
  for (uint32_t level = 1; level < count; ++level) plan.steps.push_back({Pass::kBloomDown, level});
  for (uint32_t level = count - 1; level-- > 0;) plan.steps.push_back({Pass::kBloomUp, level});
  plan.words.push_back(absl::StrFormat(
      "bloom over %d level%s from %dx%d to %dx%d: %s%s", count, count == 1 ? "" : "s", sizes.front().width,
      sizes.front().height, sizes.back().width, sizes.back().height,
      bloom.kind == BloomKind::kConserve ? absl::StrFormat("%g of the scene's light", bloom.intensity)
                                         : light_words(desc, plan.lit),
      count + (tier.bloom_level_size == 4 && bloom.levels > 1) < bloom.levels
          ? "; the frame is too small for more levels"
          : ""));
}

}  // namespace

Plan plan_frame(const FrameDesc& desc, const FrameStats& stats, bool scrubbed, const Settings& settings,
                const Tier& tier) {
  Plan plan;
  plan.steps.push_back({Pass::kIngest});
  plan.words.push_back(absl::StrFormat("ingest %dx%d %s: meter%s", desc.width, desc.height, name(desc.format),
                                       metering_words(settings.exposure.metering)));

  if (scrubbed) {
    plan.steps.push_back({Pass::kIngest});
    plan.words.push_back("ingest again with the scrub: some components are not finite or beyond +-65504");
  }

  plan_bloom(desc, stats, settings.bloom, tier, plan);
  if (tier.host_reference) {
    plan.steps.erase(std::remove_if(plan.steps.begin(), plan.steps.end(),
                                    [](const Step& step) { return step.pass != Pass::kIngest; }),
                     plan.steps.end());
  }

  plan.steps.push_back({tier.host_reference ? Pass::kReference : Pass::kResolve});
  plan.words.push_back(absl::StrFormat(
      "resolve%s: %s, %s, %s, tier %s", plan.bloom ? " with bloom" : "", name(settings.curve),
      settings.output_format == OutputFormat::kRgba16f ? "display-linear" : name(settings.transfer),
      absl::StrCat(name(settings.output_format), settings.dither ? " dithered" : ""), tier.name));
  return plan;
}

}  // namespace candela
