#include "server/schedule/render_loop.h"

#include <utility>

#include "absl/strings/str_format.h"

namespace candela {

RenderLoop::RenderLoop(Render render, size_t capacity)
    : render_(std::move(render)), queue_(capacity), thread_([this] { run(); }) {}

RenderLoop::~RenderLoop() { stop(); }

absl::StatusOr<Ticket> RenderLoop::submit(FrameJob job) {
  job.submitted = absl::Now();
  absl::MutexLock lock(&mutex_);
  if (stopping_) return absl::UnavailableError("server is stopping; send the frame to another one");
  return queue_.push(std::move(job));
}

absl::Status RenderLoop::post(std::function<void()> task) {
  absl::MutexLock lock(&mutex_);
  if (stopping_) return absl::UnavailableError("server is stopping; send the frame to another one");
  tasks_.push_back(std::move(task));
  return absl::OkStatus();
}

bool RenderLoop::cancel(Ticket ticket) {
  std::optional<FrameJob> job;  // outlives the lock, because freeing a frame's memory takes time
  absl::MutexLock lock(&mutex_);
  job = queue_.remove(ticket);
  return job.has_value();
}

size_t RenderLoop::waiting() const {
  absl::MutexLock lock(&mutex_);
  return queue_.size();
}

void RenderLoop::stop() {
  {
    absl::MutexLock lock(&mutex_);
    stopping_ = true;
  }
  if (thread_.joinable()) thread_.join();
}

void RenderLoop::run() {
  for (;;) {
    std::function<void()> task;
    std::optional<FrameJob> job;
    {
      absl::MutexLock lock(&mutex_);
      const auto ready = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
        return stopping_ || !tasks_.empty() || !queue_.empty();
      };
      mutex_.Await(absl::Condition(&ready));
      if (!tasks_.empty()) {
        task = std::move(tasks_.front());
        tasks_.pop_front();
      } else {
        job = queue_.pop();
      }
    }
    if (task) {
      task();
      continue;
    }
    if (!job) return;
    serve(*std::move(job));
  }
}

void RenderLoop::serve(FrameJob job) {
  const absl::Time start = absl::Now();
  if (start >= job.deadline) {
    job.done(absl::DeadlineExceededError(
        absl::StrFormat("frame waited %s in the queue and its deadline passed, so it was not rendered",
                        absl::FormatDuration(absl::Trunc(start - job.submitted, absl::Milliseconds(1))))));
    return;
  }
  absl::StatusOr<FrameReport> report = render_(job);
  {
    absl::MutexLock lock(&mutex_);
    queue_.charge(job.flow, absl::Now() - start);
  }
  if (!report.ok()) {
    job.done(report.status());
  } else {
    if (job.work != Work::kMeter) job.frame->memory.keep_output_only();
    job.done(RenderedFrame{*std::move(report), start - job.submitted});
  }
}

}  // namespace candela
