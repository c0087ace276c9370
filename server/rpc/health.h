// The answers of the standard gRPC health service.
#pragma once

#include <grpcpp/health_check_service_interface.h>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/base/metrics.h"

namespace candela {

// The service "liveness" is SERVING while the render thread moves and connections have not been without an
// answer for too long. The services "readiness", "candela.v1.RenderService" and "" are SERVING while good
// frames are produced, connections are answered and the server is not draining. Any thread.
class Health {
 public:
  // `metrics` outlives it.
  explicit Health(Metrics& metrics) : metrics_(metrics) {}

  // From now on updates `service`, which outlives the last pulse() and drain().
  void begin(grpc::HealthCheckServiceInterface& service);
  void pulse(bool working, bool moving);
  // The `working` of the last pulse(): a frame was rendered within heartbeat_limit.
  bool working() const;
  // `answers`: connections are answered. `alive`: they were, not too long ago.
  void door(bool answers, bool alive);
  // The server drains, and never becomes ready again.
  void drain();
  // Whether "liveness" is SERVING.
  bool alive() const;

 private:
  bool live() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return moving_ && door_alive_; }
  void tell() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  Metrics& metrics_;
  mutable absl::Mutex mutex_;
  grpc::HealthCheckServiceInterface* service_ ABSL_GUARDED_BY(mutex_) = nullptr;
  bool working_ ABSL_GUARDED_BY(mutex_) = true;
  bool moving_ ABSL_GUARDED_BY(mutex_) = true;
  bool door_answers_ ABSL_GUARDED_BY(mutex_) = true;
  bool door_alive_ ABSL_GUARDED_BY(mutex_) = true;
  bool draining_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace candela
