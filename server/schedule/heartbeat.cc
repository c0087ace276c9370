#include "server/schedule/heartbeat.h"

#include <utility>

#include "absl/synchronization/mutex.h"

namespace candela {
namespace {

constexpr int kTicksAnInterval = 4;

}  // namespace

struct Heartbeat::State {
  absl::Mutex mutex;
  bool stopping ABSL_GUARDED_BY(mutex) = false;
  bool beating ABSL_GUARDED_BY(mutex) = false;  // a beat is waiting or running
  int64_t ticks_since_good ABSL_GUARDED_BY(mutex) = 0;
  int64_t ticks_since_end ABSL_GUARDED_BY(mutex) = 0;

  void worked(bool good) {
    absl::MutexLock lock(&mutex);
    ticks_since_end = 0;
    if (good) ticks_since_good = 0;
  }
};

Heartbeat::Heartbeat(RenderLoop& loop, Clock& clock, std::function<absl::Status()> beat,
                     const Options& options, std::function<void(Pulse)> report)
    : loop_(loop),
      clock_(clock),
      beat_(std::move(beat)),
      options_(options),
      report_(std::move(report)),
      state_(std::make_shared<State>()),
      thread_([this] { run(); }) {}

Heartbeat::~Heartbeat() { stop(); }

void Heartbeat::worked(bool good) { state_->worked(good); }

void Heartbeat::stop() {
  {
    absl::MutexLock lock(&state_->mutex);
    state_->stopping = true;
  }
  if (thread_.joinable()) thread_.join();
}

void Heartbeat::run() {
  const absl::Duration tick = options_.interval / kTicksAnInterval;
  Pulse told;
  for (;;) {
    Pulse pulse;
    bool beat = false;
    {
      absl::MutexLock lock(&state_->mutex);
      if (clock_.await(state_->mutex, absl::Condition(&state_->stopping), tick)) return;
      // Ticks and not times: a process that was suspended has seen no ticks.
      ++state_->ticks_since_good;
      ++state_->ticks_since_end;
      pulse = {state_->ticks_since_good * tick <= options_.limit,
               state_->ticks_since_end * tick <= options_.moving_limit};
      beat = state_->ticks_since_good >= kTicksAnInterval && !state_->beating;
      state_->beating |= beat;
    }
    if (pulse != told) report_(told = pulse);
    if (!beat) continue;
    const auto task = [state = state_, render = beat_] {
      {
        absl::MutexLock lock(&state->mutex);
        if (state->stopping) return;
      }
      state->worked(render().ok());
      absl::MutexLock lock(&state->mutex);
      state->beating = false;
    };
    if (!loop_.post(task).ok()) return;  // the loop is stopping
  }
}

}  // namespace candela
