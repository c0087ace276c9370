// The state that all images of one `candela render` share.
#pragma once

#include <cstdint>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "client/cli/commands/render/render_report.h"
#include "client/cli/commands/server_link.h"
#include "client/cli/files/exposure_file.h"
#include "client/cli/files/sequence/frame_files.h"
#include "client/cli/options/options.h"
#include "server/base/status_macros.h"

namespace candela {

// The things that all images of a run share: the server, its limits, and the baked view of --ocio. Any thread
// may use them.
class ImageRun {
 public:
  explicit ImageRun(const RenderOptions& options) : options_(options), link_(options.server, options.quiet) {}

  // Reads the file of --locked-exposure, if it is given.
  absl::Status read_exposure() {
    if (options_.locked_exposure.empty()) return absl::OkStatus();
    const absl::StatusOr<ExposureFile> file = read_exposures(options_.locked_exposure);
    if (file.ok()) locked_ = file->locked;
    return file.status();
  }

  // Bakes the view of --ocio, if it is set, into a table. Call it before the others.
  absl::Status bake() {
    if (options_.view.config.empty()) return absl::OkStatus();
    const absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(view_, candela::bake(options_));
    bake_ms_ = ms_since(begin);
    return absl::OkStatus();
  }

  absl::StatusOr<v1::Limits> limits() {
    const absl::MutexLock lock(&mutex_);
    if (!limits_) limits_ = link_.limits();
    return *limits_;
  }

  // Waits for the built-in server. OK once link() may be called.
  absl::Status connect() {
    const absl::MutexLock lock(&mutex_);
    if (connected_) return *connected_;
    connected_ = link_.connection().status();
    if (connected_->ok()) connected_ = link_.check_tier(options_.settings.tier());
    return *connected_;
  }
  const ServerLink& link() const { return link_; }

  // Why no image can be rendered; OK as long as they can.
  absl::Status failure() {
    const absl::MutexLock lock(&mutex_);
    if (limits_ && !limits_->ok()) return limits_->status();
    return connected_.value_or(absl::OkStatus());
  }

  // Stops the built-in server and frees its memory. Connections must not be used any more.
  void close() {
    const absl::MutexLock lock(&mutex_);
    link_.close();
  }

  void begin_call() {
    const absl::MutexLock lock(&calls_mutex_);
    ++calls_;
  }
  void end_call() {
    const absl::MutexLock lock(&calls_mutex_);
    --calls_;
    ++ended_calls_;
  }
  // Waits until the call of another image has ended; false if there is none.
  bool wait_for_a_call() {
    const absl::MutexLock lock(&calls_mutex_);
    if (calls_ == 0) return false;
    const auto ended = [this, before = ended_calls_] { return ended_calls_ != before; };
    calls_mutex_.Await(absl::Condition(&ended));
    return true;
  }

  const std::optional<BakedView>& view() const { return view_; }
  // The exposure of all images, if it is given.
  std::optional<double> locked() const { return locked_; }
  double bake_ms() const { return bake_ms_; }
  // Call it after connect().
  double start_ms() const { return link_.start_ms(); }

 private:
  const RenderOptions& options_;
  absl::Mutex mutex_;
  ServerLink link_;
  std::optional<absl::StatusOr<v1::Limits>> limits_ ABSL_GUARDED_BY(mutex_);
  std::optional<absl::Status> connected_ ABSL_GUARDED_BY(mutex_);
  absl::Mutex calls_mutex_;
  int calls_ ABSL_GUARDED_BY(calls_mutex_) = 0;
  uint64_t ended_calls_ ABSL_GUARDED_BY(calls_mutex_) = 0;
  std::optional<BakedView> view_;
  std::optional<double> locked_;
  double bake_ms_ = 0;
};

}  // namespace candela
