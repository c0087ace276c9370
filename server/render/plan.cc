#include "server/render/plan.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace candela {

std::vector<LevelSize> bloom_level_sizes(uint32_t width, uint32_t height, uint32_t levels) {
  std::vector<LevelSize> sizes = {{(width + 1) / 2, (height + 1) / 2}};
  while (sizes.size() < levels) {
    const LevelSize next = {(sizes.back().width + 1) / 2, (sizes.back().height + 1) / 2};
    if (std::min(next.width, next.height) < 2) break;
    sizes.push_back(next);
  }
  return sizes;
}

const char* name(Pass pass) {
  switch (pass) {
    case Pass::kIngest:
      return "ingest";
    case Pass::kBloomDown:
      return "bloom_down";
    case Pass::kBloomUp:
      return "bloom_up";
    case Pass::kResolve:
      return "resolve";
  }
  return "unknown";
}

Plan plan_frame(const FrameDesc& desc, const FrameStats& stats, bool scrubbed, const Settings& settings,
                const Tier& tier) {
  Plan plan;
  plan.steps.push_back({Pass::kIngest});
  plan.words.push_back(absl::StrFormat("ingest %dx%d %s: meter%s", desc.width, desc.height, name(desc.format),
                                       settings.bloom.intensity > 0 ? ", bloom level 0" : ""));

  if (scrubbed) {
    plan.steps.push_back({Pass::kIngest});
    plan.words.push_back("ingest again with the scrub: some components are not finite or beyond +-65504");
  }

  if (settings.bloom.intensity == 0) {
    plan.words.push_back("no bloom: its intensity is 0");
  } else if (stats.bright_texels == 0) {
    plan.words.push_back(absl::StrFormat("no bloom: nothing passes the threshold %g (the brightest is %g)",
                                         settings.bloom.threshold, stats.max_luminance));
  } else {
    plan.bloom = true;
    const std::vector<LevelSize> sizes = bloom_level_sizes(desc.width, desc.height, settings.bloom.levels);
    const auto count = static_cast<uint32_t>(sizes.size());
    for (uint32_t level = 1; level < count; ++level) plan.steps.push_back({Pass::kBloomDown, level});
    for (uint32_t level = count - 1; level-- > 0;) plan.steps.push_back({Pass::kBloomUp, level});
    plan.words.push_back(
        absl::StrFormat("bloom over %d level%s from %dx%d to %dx%d: %d bright texels%s", count,
                        count == 1 ? "" : "s", sizes.front().width, sizes.front().height, sizes.back().width,
                        sizes.back().height, stats.bright_texels,
                        count < settings.bloom.levels ? "; the frame is too small for more levels" : ""));
  }

  plan.steps.push_back({Pass::kResolve});
  plan.words.push_back(absl::StrFormat(
      "resolve%s: %s, %s, %s, tier %s", plan.bloom ? " with bloom" : "", name(settings.curve),
      settings.output_format == OutputFormat::kRgba16f ? "display-linear" : name(settings.transfer),
      name(settings.output_format), tier.name));
  return plan;
}

}  // namespace candela
