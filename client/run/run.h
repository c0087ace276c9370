// What every run begins with: the server, its limits, the baked view of --ocio, and a locked exposure.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "client/run/baked_view.h"
#include "client/run/events.h"
#include "client/run/options.h"
#include "client/run/server_link.h"

namespace candela {

// Any thread may use it, but for link(), which says itself who may.
class Run {
 public:
  // Starts the built-in server, if the options name none. They and the events must outlive it.
  Run(const RunOptions& options, RunEvents& events);

  // Reads the file of --locked-exposure, if it is given.
  absl::Status read_exposure();
  // Bakes the view of --ocio, if it is set, into a table. Call both before the others.
  absl::Status bake();

  absl::StatusOr<v1::Limits> limits();

  // Waits for the built-in server, and checks the tier. OK once calls may be made.
  absl::Status connect();
  ServerLink& link() { return link_; }

  // Why no image can be rendered; OK as long as they can.
  absl::Status failure();

  // Stops the built-in server and frees its memory. Connections must not be used any more.
  void close();

  void begin_call();
  void end_call();
  // Waits until the call of another image has ended; false if there is none.
  bool wait_for_a_call();

  // Null without --ocio.
  const std::shared_ptr<const BakedView>& view() const { return view_; }
  // False if the view shows the files' values as they are (data): then no gamut cuts anything.
  bool shows_light() const { return view_ == nullptr || !view_->view.as_is; }
  // The settings of all frames, without the view.
  const v1::Settings& settings() const { return options_.settings; }
  // The exposure of all images, if it is given.
  std::optional<double> locked() const { return locked_; }
  double bake_ms() const { return bake_ms_; }
  // The start-up time of the built-in server; 0 for a running one. Call it after connect().
  double start_ms() const { return link_.start_ms(); }

 private:
  const RunOptions& options_;
  RunEvents& events_;
  absl::Mutex mutex_;
  ServerLink link_;
  std::optional<absl::StatusOr<v1::Limits>> limits_ ABSL_GUARDED_BY(mutex_);
  std::optional<absl::Status> connected_ ABSL_GUARDED_BY(mutex_);
  absl::Mutex calls_mutex_;
  int calls_ ABSL_GUARDED_BY(calls_mutex_) = 0;
  uint64_t ended_calls_ ABSL_GUARDED_BY(calls_mutex_) = 0;
  std::shared_ptr<const BakedView> view_;
  std::optional<double> locked_;
  double bake_ms_ = 0;
};

}  // namespace candela
