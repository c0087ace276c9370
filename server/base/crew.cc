#include "server/base/crew.h"

#include <system_error>

#include "server/base/log.h"
#include "server/base/slices.h"

namespace candela {

Crew::Crew(uint32_t threads) {
  try {
    for (uint32_t i = 1; i < threads; ++i) threads_.emplace_back([this] { serve(); });
  } catch (const std::system_error& error) {
    log_event(LogLevel::kWarning, "no more threads can be started",
              {{"threads", uint64_t{this->threads()}}, {"of", uint64_t{threads}}, {"error", error.what()}});
  }
}

Crew::~Crew() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  for (std::thread& thread : threads_) thread.join();
}

void Crew::run(uint32_t units, absl::FunctionRef<void(uint32_t unit)> work) {
  Job job = {work, units};
  while (job.next < units) {
    checkpoint();
    job.end = slice_end();
    run_slice(job);
  }
}

void Crew::run_slice(Job& job) {
  if (threads_.empty() || job.units - job.next <= 1) return take_units(job);
  {
    absl::MutexLock lock(&mutex_);
    job_ = &job;
  }
  take_units(job);
  // A thread that has not woken up yet is not waited for.
  absl::MutexLock lock(&mutex_);
  job_ = nullptr;
  const auto alone = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return helping_ == 0; };
  mutex_.Await(absl::Condition(&alone));
}

void Crew::take_units(Job& job) {
  using Steady = std::chrono::steady_clock;
  const bool in_slices = job.end != Steady::time_point::max();
  for (uint32_t unit = job.next++; unit < job.units; unit = job.next++) {
    job.work(unit);
    if (in_slices && Steady::now() >= job.end) return;
  }
}

void Crew::serve() {
  const auto called = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return stopping_ || job_ != nullptr; };
  absl::MutexLock lock(&mutex_);
  for (;;) {
    mutex_.Await(absl::Condition(&called));
    if (stopping_) return;
    Job* const job = job_;
    ++helping_;
    mutex_.Unlock();
    take_units(*job);
    mutex_.Lock();
    // All units are taken, or the slice is over. Without this the threads would take the job again until its
    // caller notices.
    if (job_ == job) job_ = nullptr;
    --helping_;
  }
}

}  // namespace candela
