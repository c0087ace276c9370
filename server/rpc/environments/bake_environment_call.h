// One BakeEnvironment call: a request, and the faces of a cube map.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "server/rpc/environments/environment_call.h"
#include "server/session/environments/environment_start.h"

namespace candela {

// The bake's textures are freed before its faces are sent.
class BakeEnvironmentCall final : public EnvironmentCall {
 public:
  // `state` outlives the call.
  static std::shared_ptr<ServerCall> begin(CallTransport& transport, ServiceState& state);

 private:
  struct Work;

  using EnvironmentCall::EnvironmentCall;

  absl::Status on_read(bool message) override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_sent() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status check_upload(absl::Time, absl::Duration) override { return absl::OkStatus(); }
  void on_finish(const absl::Status& status, const std::string& message) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Status take_request() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_memory() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status enqueue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  std::shared_ptr<Work> work_ ABSL_GUARDED_BY(mutex_);
  // The next message to send.
  bool header_sent_ ABSL_GUARDED_BY(mutex_) = false;
  uint32_t face_ ABSL_GUARDED_BY(mutex_) = 0;  // over all levels
  bool face_begun_ ABSL_GUARDED_BY(mutex_) = false;
  uint32_t row_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace candela
