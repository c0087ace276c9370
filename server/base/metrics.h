// Metrics for Prometheus, in base units. Clients cannot choose labels.
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

// Why a call or a session was refused before it had a frame.
enum class Rejection {
  kCalls,     // too many calls
  kSessions,  // too many sessions
  kDraining,
  kMemory,   // the memory budget is full of frames in flight
  kSize,     // a frame that can never fit
  kRequest,  // an invalid first message
  kPromise,  // no tier can keep the promise
  kToken,    // a resume token that cannot be used
  kAccess,   // a missing or unknown bearer token
};

// The server's counters. Any thread.
class Metrics {
 public:
  // Values that are read when Prometheus asks.
  struct Sample {
    uint64_t queue_frames = 0;
    uint64_t memory_in_use_bytes = 0;  // of the texture pool
    uint64_t memory_idle_bytes = 0;
    uint64_t memory_budget_bytes = 0;  // the limit of both together
  };

  // The arguments become labels of candela_build_info.
  Metrics(const std::string& version, const std::string& device, const std::string& driver);
  ~Metrics();

  // `stage` is a fixed name: "queue", a pass, or "encode".
  void stage(absl::string_view stage, absl::Duration time);
  // Call it once per frame that got memory, with the status that it ended with.
  void frame_ended(absl::StatusCode code);
  void rejected(Rejection reason);
  void session_began();
  void session_ended();
  void bytes_in(uint64_t bytes);
  void bytes_out(uint64_t bytes);
  void device_rebuilt();
  // `ready`: frames are rendered and the server is not draining. `live`: the render thread makes progress.
  void health(bool ready, bool live);

  // Sets the function that provides Sample. An empty one, the initial state, provides zeros. Returns when no
  // call of the previous function is running any more.
  void set_sampler(std::function<Sample()> sampler);

 private:
  friend class MetricsServer;
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

// An HTTP port for monitoring without gRPC: GET /metrics, GET /livez and GET /readyz. The latter two answer
// 200 if health says SERVING for "liveness" and "readiness", else 503.
class MetricsServer {
 public:
  // `address` must have passed check_metrics_address; port 0 picks a free port. UNAVAILABLE if it cannot
  // listen there.
  static absl::StatusOr<std::unique_ptr<MetricsServer>> start(const Metrics& metrics,
                                                              const std::string& address);
  ~MetricsServer();

  // With the port that was picked.
  const std::string& address() const { return address_; }

 private:
  class Page;
  struct Impl;
  MetricsServer(std::unique_ptr<Impl> impl, std::string address);
  const std::unique_ptr<Impl> impl_;
  const std::string address_;
};

}  // namespace candela
