// What a session answers if nothing disturbs it, computed from all of its frames at once.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "server/render/plan/exposure.h"
#include "server/render/settings/settings.h"
#include "tests/support/simulated/frame_maker.h"

namespace candela::testing {

// A frame that a client sends. All those of a run have the settings that count for them.
struct SimulatedFrame {
  FrameDesc desc;
  std::vector<std::byte> pixels;  // tight rows
  Settings settings = {};
  uint64_t sequence = 0;
  int64_t media_time_ns = 0;
  bool cut = false;
  std::optional<double> given = std::nullopt;  // the exposure that it brings
};

struct SimulatedAnswer {
  absl::Status status;
  Exposed exposed;
  std::vector<std::byte> image;
  double before = 0.0;  // the exposure that it adapted from
  bool cut = false;     // it began a scene
};

// docs/pipeline.md sections 3 and 7, apart from what a server does: nothing here knows when a frame comes,
// and nothing is resumed. Frames with settings that reject their pixels fail. One answer a frame.
std::vector<SimulatedAnswer> undisturbed_run(const std::vector<SimulatedFrame>& frames, uint32_t lookahead,
                                             double cut_threshold_ev);

}  // namespace candela::testing
