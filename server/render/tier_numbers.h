// What each tier costs on this device, measured when it is first asked for.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/render/renderer.h"
#include "server/render/settings/tier_choice.h"

namespace candela {

// One thread at a time, the renderer's.
class TierBenchmark {
 public:
  // `renderer` gives the one to measure with. `device`: what tells devices and drivers apart. `cache_file`
  // keeps the numbers for the next start; empty: none. A file that cannot be read or written only costs the
  // time to measure again.
  TierBenchmark(std::function<std::shared_ptr<Renderer>()> renderer, std::string device,
                std::string cache_file);

  // The numbers of all tiers for frames like this one: the median device time of some frames of this size
  // (those beyond 8 megapixels are reckoned from one of 8), and the largest error of small ones that are full
  // of lights, half as much again, but never less than the tier's own bound. Takes a second or so the first
  // time, no time after that. Fails as the renderer does.
  absl::StatusOr<std::vector<TierNumbers>> numbers(const FrameDesc& desc, const Settings& settings);

  // The tier by which the settings' promise is kept for frames like this one; fails as numbers() and
  // choose_tier() do.
  absl::StatusOr<TierChoice> choose(const FrameDesc& desc, const Settings& settings);

 private:
  absl::StatusOr<TierNumbers> measure(const FrameDesc& desc, const Settings& settings);
  void load();
  void save() const;

  const std::function<std::shared_ptr<Renderer>()> renderer_;
  const std::string device_;
  const std::string cache_file_;
  std::map<std::string, std::vector<TierNumbers>> known_;
};

}  // namespace candela
