// Measures the time and error of each tier on this device, when they are first needed.
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
  // `renderer` returns the renderer to measure with. `device` identifies the device and its driver.
  // `cache_file` keeps the numbers for the next start; empty: none. If the file cannot be read or written,
  // the tiers are measured again.
  TierBenchmark(std::function<std::shared_ptr<Renderer>()> renderer, std::string device,
                std::string cache_file);

  // The numbers of all tiers for frames like this one. The time is the median device time of a few frames of
  // this size; for frames beyond 8 megapixels it is extrapolated from one of 8. The error is 1.5 times the
  // largest error of a small frame full of lights, but at least the tier's own bound. Takes about a second
  // the first time, and no time after that. Fails as the renderer does.
  absl::StatusOr<std::vector<TierNumbers>> numbers(const FrameDesc& desc, const Settings& settings);

  // The tier that keeps the settings' promise for frames like this one. Fails as numbers() and choose_tier()
  // do.
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
