// One PutEnvironment call: a panorama's upload, and what is found out about it.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "proto/candela/v1/environment_id.h"
#include "server/rpc/environments/environment_call.h"
#include "server/rpc/wire/band_reader.h"
#include "server/session/environments/environment_start.h"

namespace candela {

// Goes through these states, and may finish in any of them:
//
//   start -> first band -> bands -> whole
//
// The panorama gets its memory when the first band is here, as frames do.
class PutEnvironmentCall final : public EnvironmentCall {
 public:
  // `state` outlives the call.
  static std::shared_ptr<ServerCall> begin(CallTransport& transport, ServiceState& state);

 private:
  enum class State { kStart, kFirstBand, kBands, kWhole };
  // What the render thread works on.
  struct Work;

  using EnvironmentCall::EnvironmentCall;

  absl::Status on_read(bool message) override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_sent() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status check_upload(absl::Time now, absl::Duration idle) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void on_finish(const absl::Status& status, const std::string& message) override
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  absl::Status take_start() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_memory() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_band() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status take_half_close() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status enqueue() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void answer(const v1::Environment& environment) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  State reading_ ABSL_GUARDED_BY(mutex_) = State::kStart;
  std::optional<PanoramaStart> start_ ABSL_GUARDED_BY(mutex_);
  std::optional<v1::EnvironmentId> id_ ABSL_GUARDED_BY(mutex_);
  std::optional<BandReader> bands_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::byte> rows_ ABSL_GUARDED_BY(mutex_);  // of the band that is read
  uint32_t rows_read_ ABSL_GUARDED_BY(mutex_) = 0;
  std::shared_ptr<Work> work_ ABSL_GUARDED_BY(mutex_);
  absl::Time admitted_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace candela
