#include "server/base/slices.h"

#include <utility>

namespace candela {
namespace {

struct Cancelled {};

thread_local SlicedWork* current = nullptr;

}  // namespace

void checkpoint() {
  if (current != nullptr && SlicedWork::Clock::now() >= current->end_) current->pause();
}

std::chrono::steady_clock::time_point slice_end() {
  return current == nullptr ? SlicedWork::Clock::time_point::max() : current->end_;
}

std::chrono::nanoseconds time_paused() {
  return current == nullptr ? std::chrono::nanoseconds{0} : current->paused_;
}

SlicedWork::SlicedWork(std::function<void()> work) : work_(std::move(work)) {}

SlicedWork::~SlicedWork() {
  if (!thread_.joinable()) return;
  {
    absl::MutexLock lock(&mutex_);
    if (state_ == State::kPaused) {
      cancelled_ = true;
      resume(Clock::time_point::max());  // what the work destroys does not pause again
    }
  }
  thread_.join();
}

bool SlicedWork::run(absl::Duration length) {
  absl::MutexLock lock(&mutex_);
  resume(length == absl::InfiniteDuration() ? Clock::time_point::max()
                                            : Clock::now() + absl::ToChronoNanoseconds(length));
  if (!thread_.joinable()) thread_ = std::thread([this] { main(); });
  const auto stopped = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return state_ != State::kRunning; };
  mutex_.Await(absl::Condition(&stopped));
  return state_ == State::kEnded;
}

void SlicedWork::resume(Clock::time_point end) {
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
  const Clock::time_point begin = Clock::now();
  absl::MutexLock lock(&mutex_);
  state_ = State::kPaused;
  const auto resumed = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return state_ == State::kRunning; };
  mutex_.Await(absl::Condition(&resumed));
  paused_ += Clock::now() - begin;
  if (cancelled_) throw Cancelled{};
}

}  // namespace candela
