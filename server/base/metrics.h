// Numbers for Prometheus: base units, and no label that a client chooses.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace candela {

// Why a call or a session was turned away before it had a frame.
enum class Rejection {
  kCalls,     // as many calls as the server takes
  kSessions,  // as many sessions
  kDraining,
  kMemory,   // the memory budget is full of frames in flight
  kSize,     // a frame that can never fit
  kRequest,  // a first message that is not as the contract says
  kPromise,  // no tier keeps it
  kToken,    // a resume token that cannot be used
  kAccess,   // a bearer token that is missing or not known
};

// What the server counts. Any thread.
class Metrics {
 public:
  // What is asked for when it is collected.
  struct Sample {
    uint64_t queue_frames = 0;
    uint64_t memory_in_use_bytes = 0;  // of the texture pool
    uint64_t memory_idle_bytes = 0;
    uint64_t memory_budget_bytes = 0;  // what both together may have
  };

  // The arguments become labels of candela_build_info.
  Metrics(const std::string& version, const std::string& device, const std::string& driver);
  ~Metrics();

  // `stage` is a name of ours: "queue", a pass, "encode".
  void stage(absl::string_view stage, absl::Duration time);
  // Once for each frame whose memory was taken: how it ended.
  void frame_ended(absl::StatusCode code);
  void rejected(Rejection reason);
  void session_began();
  void session_ended();
  void bytes_in(uint64_t bytes);
  void bytes_out(uint64_t bytes);
  void device_rebuilt();
  // What health says: frames come out and the server does not drain; the render thread moves.
  void health(bool ready, bool live);

  // Whom to ask; until then, and after an empty one, nobody. Returns when the last question to the one before
  // has been answered.
  void set_sampler(std::function<Sample()> sampler);

 private:
  friend class MetricsServer;
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

// A port of its own for whoever watches the server and speaks no gRPC: GET /metrics; GET /livez and /readyz,
// 200 where health says SERVING for "liveness" and "readiness", else 503.
class MetricsServer {
 public:
  // `address` has passed check_metrics_address; port 0 takes a free one. UNAVAILABLE when it cannot be
  // listened on.
  static absl::StatusOr<std::unique_ptr<MetricsServer>> start(const Metrics& metrics,
                                                              const std::string& address);
  ~MetricsServer();

  // With the port that was taken.
  const std::string& address() const { return address_; }

 private:
  class Page;
  struct Impl;
  MetricsServer(std::unique_ptr<Impl> impl, std::string address);
  const std::unique_ptr<Impl> impl_;
  const std::string address_;
};

}  // namespace candela
