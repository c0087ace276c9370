// Metrics for Prometheus, in base units: candela_* and process_*. Clients cannot choose labels.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "server/base/clock.h"
#include "server/base/http_pages.h"

namespace candela {

// Why a call, a session or a frame was refused before it had memory.
enum class Rejection {
  kCalls,     // too many calls
  kSessions,  // too many sessions
  kDraining,
  kMemory,   // the memory budget is full of frames in flight
  kSize,     // a frame that can never fit
  kRequest,  // an invalid message, or a session name that is taken
  kToken,    // a resume token that cannot be used
  kAccess,   // a missing or unknown bearer token
};

// Why a connection was closed as soon as it was accepted.
enum class ConnectionRefusal {
  kLimit,        // max-connections are open
  kDescriptors,  // the process has no file descriptor left
};

// The server's counters. Any thread.
class Metrics {
 public:
  // Values that are read when Prometheus asks.
  struct Sample {
    uint64_t queue_frames = 0;
    uint64_t memory_in_use_bytes = 0;  // of the texture pool
    uint64_t memory_idle_bytes = 0;
    uint64_t memory_frames_bytes = 0;  // frames in flight, and the files made of them
    uint64_t memory_budget_bytes = 0;  // of the first two together, and of the third
    uint64_t environment_bytes = 0;    // those that are kept, a part of the memory in use
    uint64_t environment_budget_bytes = 0;
    uint64_t connections = 0;
    std::optional<absl::Time> certificate_expires = std::nullopt;  // of the server's own; absent: no TLS
  };

  // The arguments become labels of candela_build_info.
  // `passes`: who makes a frame's passes, in words.
  Metrics(const std::string& version, const std::string& device, const std::string& driver,
          const std::string& passes);
  ~Metrics();

  // `stage` is a fixed name: "queue", a pass, or "encode".
  void stage(absl::string_view stage, absl::Duration time);
  // Call it once per frame that got memory, with the status that it ended with.
  void frame_ended(absl::StatusCode code);
  void rejected(Rejection reason);
  void connection_refused(ConnectionRefusal reason);
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
  // `address` must have passed check_metrics_address; port 0 picks a free port. Slow clients keep nobody from
  // an answer, see HttpPages. `clock` outlives it. UNAVAILABLE if it cannot listen there.
  static absl::StatusOr<std::unique_ptr<MetricsServer>> start(const Metrics& metrics,
                                                              const std::string& address,
                                                              size_t max_connections, Clock& clock);
  ~MetricsServer();

  // With the port that was picked.
  const std::string& address() const { return pages_->address(); }

 private:
  explicit MetricsServer(std::unique_ptr<HttpPages> pages);
  const std::unique_ptr<HttpPages> pages_;
};

}  // namespace candela
