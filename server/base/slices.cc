#include "server/base/slices.h"

#include <utility>

namespace candela {
namespace {

struct Cancelled {};

thread_local SlicedWork* current = nullptr;

}  // namespace

void checkpoint() {
  if (current != nullptr && current->clock_.steady() >= current->end_) current->pause();
}

std::chrono::steady_clock::time_point slice_end() {
  return current == nullptr ? SlicedWork::Moment::max() : current->end_;
}

std::chrono::nanoseconds time_paused() {
  return current == nullptr ? std::chrono::nanoseconds{0} : current->paused_;
}

SlicedWork::SlicedWork(std::function<void()> work, Clock& clock) : work_(std::move(work)), clock_(clock) {}

SlicedWork::~SlicedWork() {
  if (!thread_.joinable()) return;
  {
    absl::MutexLock lock(&mutex_);
    if (state_ == State::kPaused) {
      cancelled_ = true;
      resume(Moment::max());  // what the work destroys does not pause again
    }
  }
  thread_.join();
}

bool SlicedWork::run(absl::Duration length) {
  absl::MutexLock lock(&mutex_);
  resume(length == absl::InfiniteDuration() ? Moment::max()
                                            : clock_.steady() + absl::ToChronoNanoseconds(length));
  if (!thread_.joinable()) thread_ = std::thread([this] { main(); });
  const auto stopped = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return state_ != State::kRunning; };
  mutex_.Await(absl::Condition(&stopped));
  return state_ == State::kEnded;
}

void SlicedWork::resume(Moment end) {
  end_ = end;
  state_ = State::kRunning;
}

void SlicedWork::main() {
  current = this;
  try {
    work_();
  } catch (const Cancelled&) {
  }
  work_ = nullptr;  // what it holds is released within the slice
  absl::MutexLock lock(&mutex_);
  state_ = State::kEnded;
}

void SlicedWork::pause() {
  const Moment begin = clock_.steady();
  absl::MutexLock lock(&mutex_);
  state_ = State::kPaused;
  const auto resumed = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return state_ == State::kRunning; };
  mutex_.Await(absl::Condition(&resumed));
  paused_ += clock_.steady() - begin;
  if (cancelled_) throw Cancelled{};
}

}  // namespace candela
