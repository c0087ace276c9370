// What the standard health service says.
#pragma once

#include <grpcpp/health_check_service_interface.h>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "server/base/metrics.h"

namespace candela {

// "liveness": the process and its render thread move. "readiness", "candela.v1.RenderService" and "": frames
// come out, and the server does not drain. Any thread.
class Health {
 public:
  // `metrics` outlives it.
  explicit Health(Metrics& metrics) : metrics_(metrics) {}

  // From now on `service` says how it is; it outlives the last pulse() and drain().
  void begin(grpc::HealthCheckServiceInterface& service);
  void pulse(bool working, bool moving);
  // For good.
  void drain();
  // What "liveness" is.
  bool alive() const;

 private:
  void tell() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  Metrics& metrics_;
  mutable absl::Mutex mutex_;
  grpc::HealthCheckServiceInterface* service_ ABSL_GUARDED_BY(mutex_) = nullptr;
  bool working_ ABSL_GUARDED_BY(mutex_) = true;
  bool moving_ ABSL_GUARDED_BY(mutex_) = true;
  bool draining_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace candela
