// What the calls of one service share.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>

#include "absl/time/time.h"
#include "server/render/renderer.h"
#include "server/render/tier_numbers.h"
#include "server/rpc/call_gate.h"
#include "server/stream/render_loop.h"

namespace candela {

// Any thread. Outlives every call.
struct Backend {
  std::shared_ptr<Renderer> renderer;  // with its device and its pool: frames hold on to all three
  RenderLoop& loop;
  TierMeter& tier_meter;  // on the loop's thread
  FrameLimits limits;
  absl::Duration idle_timeout;
  std::string device;  // its own name
  CallGate gate;
  std::atomic<uint64_t> frames_rendered{0};
};

}  // namespace candela
