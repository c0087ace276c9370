#include "client/run/run.h"

#include "absl/time/clock.h"
#include "client/run/exposure_file.h"
#include "client/run/report.h"
#include "server/base/status_macros.h"

namespace candela {

Run::Run(const RunOptions& options, RunEvents& events)
    : options_(options), events_(events), link_(options.server, events) {}

absl::Status Run::read_exposure() {
  if (options_.locked_exposure.empty()) return absl::OkStatus();
  ASSIGN_OR_RETURN(const ExposureFile file, read_exposures(options_.locked_exposure));
  locked_ = file.locked;
  return absl::OkStatus();
}

absl::Status Run::bake() {
  if (options_.view.config.empty()) return absl::OkStatus();
  events_.begins("baking " + options_.view.config);
  const absl::Time begin = absl::Now();
  ASSIGN_OR_RETURN(BakedView baked, candela::bake(options_));
  view_ = std::make_shared<const BakedView>(std::move(baked));
  bake_ms_ = ms_since(begin);
  return absl::OkStatus();
}

absl::StatusOr<v1::Limits> Run::limits() {
  const absl::MutexLock lock(&mutex_);
  if (!limits_) limits_ = link_.limits();
  return *limits_;
}

absl::Status Run::connect() {
  const absl::MutexLock lock(&mutex_);
  if (connected_) return *connected_;
  connected_ = link_.connection().status();
  if (connected_->ok()) connected_ = link_.check_tier(options_.settings.tier());
  return *connected_;
}

absl::Status Run::failure() {
  const absl::MutexLock lock(&mutex_);
  if (limits_ && !limits_->ok()) return limits_->status();
  return connected_.value_or(absl::OkStatus());
}

void Run::close() {
  const absl::MutexLock lock(&mutex_);
  link_.close();
}

void Run::begin_call() {
  const absl::MutexLock lock(&calls_mutex_);
  ++calls_;
}

void Run::end_call() {
  const absl::MutexLock lock(&calls_mutex_);
  --calls_;
  ++ended_calls_;
}

bool Run::wait_for_a_call() {
  const absl::MutexLock lock(&calls_mutex_);
  if (calls_ == 0) return false;
  const auto ended = [this, before = ended_calls_] { return ended_calls_ != before; };
  calls_mutex_.Await(absl::Condition(&ended));
  return true;
}

}  // namespace candela
