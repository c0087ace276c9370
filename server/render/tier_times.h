// The time of each tier on this device.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "server/render/renderer.h"

namespace candela {

struct MeasuredTime {
  uint32_t width;
  uint32_t height;
  double ms;  // median device time of a frame
};

// In the order of tiers(), for two sizes each, the small one first.
using TierTimes = std::vector<std::vector<MeasuredTime>>;

// Renders a few frames of kUsualFormat with default settings for each tier, of at most half a megapixel, and
// far fewer pixels on the host. There is a checkpoint() before each. Takes about half a second. The render
// thread only. Fails as the renderer does.
absl::StatusOr<TierTimes> measure_tiers(Renderer& renderer);

}  // namespace candela
