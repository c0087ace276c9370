// State that all calls of one server share.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/time/time.h"
#include "server/base/clock.h"
#include "server/base/metrics.h"
#include "server/base/worker_pool.h"
#include "server/render/frame_maker.h"
#include "server/schedule/render_loop.h"
#include "server/session/environment_store.h"
#include "server/session/memory_region.h"
#include "server/session/sessions.h"

namespace candela {

// Everything that renders and encodes frames. Any thread.
struct Rendering {
  // The renderer of the current device. A frame asks once and keeps it, because its memory lives there.
  std::function<std::shared_ptr<FrameMaker>()> renderer;
  RenderSteps& loop;
  WorkerPool& encoders;
  const std::string device;  // name of the Vulkan device
  const std::string bits;    // see DeviceInfo
  std::atomic<uint64_t> frames_rendered{0};
};

struct CallLimits {
  FrameLimits frame;
  absl::Duration idle_timeout;
  uint32_t max_frames_in_flight = 0;  // per session
  bool tokens = false;                // calls need a bearer token
};

// Any thread. Outlives every call.
struct ServiceState {
  Clock& clock;
  Timers& timers;
  Rendering rendering;
  const CallLimits limits;
  Metrics& metrics;
  CallGate call_gate;  // Render, Meter, PutEnvironment and BakeEnvironment calls
  CallGate session_gate;
  Sessions sessions;
  EnvironmentStore environments;
  MemoryRegions regions{};
};

}  // namespace candela
