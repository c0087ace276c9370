// What the calls of one service share.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/time/time.h"
#include "server/base/metrics.h"
#include "server/base/worker_pool.h"
#include "server/render/renderer.h"
#include "server/render/tier_numbers.h"
#include "server/rpc/call_gate.h"
#include "server/schedule/render_loop.h"
#include "server/session/lookahead_memory.h"
#include "server/session/resume_token.h"
#include "server/session/session_table.h"

namespace candela {

// How many idle timeouts a frame's upload may take in all: a row a minute is progress too, but not for days.
inline constexpr int kMaxUploadTimeouts = 10;

// Any thread. Outlives every call.
struct Backend {
  // The current device's, with its pool: frames hold on to all three. Ask once for a frame.
  std::function<std::shared_ptr<Renderer>()> renderer;
  RenderLoop& loop;
  TierBenchmark& tier_meter;  // on the loop's thread
  FrameLimits limits;
  absl::Duration idle_timeout;
  uint32_t max_frames_in_flight;  // of a session
  uint64_t memory_budget_bytes;
  std::string device;  // its own name
  WorkerPool& encoders;
  TokenKeys keys;
  Metrics& metrics;
  CallGate gate;          // Render and Meter calls
  CallGate session_gate;  // streams
  SessionTable sessions{};
  LookaheadMemory lookahead_memory;
  std::atomic<Flow> next_session_flow{1};  // odd: a session's; even: a connection's
  std::atomic<uint64_t> frames_rendered{0};
};

}  // namespace candela
