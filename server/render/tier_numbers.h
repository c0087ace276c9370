// Measures the time of each tier on this device, when it is first needed.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/synchronization/mutex.h"
#include "server/render/renderer.h"
#include "server/render/settings/tier_choice.h"

namespace candela {

struct MeasuredTime {
  uint32_t width;
  uint32_t height;
  double ms;  // median device time of a frame
};

// Any thread, except measure().
class TierBenchmark {
 public:
  // Called before each piece of work. An error ends the measurement with it.
  using Checkpoint = std::function<absl::Status()>;

  // `renderer` returns the renderer to measure with. `device` identifies the device and its driver.
  // `cache_file` keeps the times for the next start; empty: none. If the file cannot be read or written,
  // the tiers are measured again.
  TierBenchmark(std::function<std::shared_ptr<Renderer>()> renderer, std::string device,
                std::string cache_file);

  // Measurements of one client run one after the other: if many alternated by slices, none would end in time.
  // The result is the right to measure for `client`, until it is destroyed; null while another holds it.
  std::shared_ptr<void> take_turn(uint64_t client);

  // The times of all tiers for frames like this one; absent if frames of its format with these settings are
  // not measured yet. They are on the line through the times of two small frames.
  std::optional<std::vector<TierNumbers>> known(const FrameDesc& desc, const Settings& settings) const;

  // The times of those two frames; empty if they are not measured yet.
  std::vector<MeasuredTime> measured(const Tier& tier, v1::PixelFormat format,
                                     const Settings& settings) const;

  // Measures all tiers: each a few frames of at most half a megapixel, and far fewer pixels on the host. A
  // piece is one frame. Takes about half a second. The render thread only. Fails as the renderer and the
  // checkpoint do.
  absl::Status measure(v1::PixelFormat format, const Settings& settings, const Checkpoint& checkpoint);

 private:
  // The medians of both sizes, in the order of tiers().
  using Times = std::vector<std::array<double, 2>>;

  std::string key(v1::PixelFormat format, const Settings& settings) const;
  void load();
  std::string to_text() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void save(const std::string& text) const;

  const std::function<std::shared_ptr<Renderer>()> renderer_;
  const std::string device_;
  const std::string cache_file_;
  mutable absl::Mutex mutex_;
  std::map<std::string, Times> known_ ABSL_GUARDED_BY(mutex_);
  std::set<uint64_t> measuring_ ABSL_GUARDED_BY(mutex_);  // the clients that have a turn
};

}  // namespace candela
