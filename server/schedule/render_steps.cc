#include "server/schedule/render_steps.h"

#include <system_error>
#include <utility>

#include "absl/strings/str_format.h"

namespace candela {

namespace {

bool takes_long(const FrameJob& job) {
  return job.task != nullptr || job.frame->long_source || job.frame->memory.takes_long();
}

}  // namespace

RenderSteps::RenderSteps(Render render, size_t capacity, Clock& clock, absl::Duration slice)
    : render_(std::move(render)), clock_(clock), slice_(slice), queue_(capacity) {}

absl::StatusOr<Ticket> RenderSteps::submit(FrameJob job) {
  job.submitted = clock_.now();
  job.in_slices |= takes_long(job);
  job.ordered &= job.task == nullptr;
  absl::MutexLock lock(&mutex_);
  if (closed_) return absl::UnavailableError("server is stopping; send the frame to another one");
  return queue_.push(std::move(job));
}

absl::Status RenderSteps::post(std::function<void()> task) {
  absl::MutexLock lock(&mutex_);
  if (closed_) return absl::UnavailableError("server is stopping; send the frame to another one");
  tasks_.push_back(std::move(task));
  return absl::OkStatus();
}

bool RenderSteps::cancel(Ticket ticket) {
  std::optional<FrameJob> job;  // outlives the lock, because freeing a frame's memory takes time
  absl::MutexLock lock(&mutex_);
  job = queue_.remove(ticket);
  if (!job && running_ == ticket) last_slice_ = true;
  return job.has_value();
}

void RenderSteps::charge(Flow flow, absl::Duration time) {
  absl::MutexLock lock(&mutex_);
  queue_.charge_elsewhere(flow, time);
}

size_t RenderSteps::waiting() const {
  absl::MutexLock lock(&mutex_);
  return queue_.size();
}

void RenderSteps::close() {
  absl::MutexLock lock(&mutex_);
  closed_ = true;
}

bool RenderSteps::wait() {
  absl::MutexLock lock(&mutex_);
  const auto ready = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return closed_ || !tasks_.empty() || !queue_.empty();
  };
  mutex_.Await(absl::Condition(&ready));
  return !tasks_.empty() || !queue_.empty();
}

bool RenderSteps::step() {
  std::function<void()> task;
  std::optional<FrameJob> job;
  {
    absl::MutexLock lock(&mutex_);
    // The heartbeat goes first: behind clients' jobs it would take a full queue for a stuck thread.
    if (!tasks_.empty()) {
      task = std::move(tasks_.front());
      tasks_.pop_front();
    } else {
      job = queue_.pop();
      running_ = job ? job->ticket : 0;
      last_slice_ = false;
    }
  }
  if (task) {
    task();
  } else if (job) {
    serve(*std::move(job));
  } else {
    return false;
  }
  return true;
}

void RenderSteps::serve(FrameJob job) {
  const absl::Time start = clock_.now();
  // A job that has begun is finished even after its deadline, because most of its work may be done.
  const bool begins = job.slices == nullptr;
  if (begins && start >= job.deadline) {
    return job.done(absl::DeadlineExceededError(
        absl::StrFormat("frame waited %s in the queue and its deadline passed, so it was not rendered",
                        absl::FormatDuration(absl::Trunc(start - job.submitted, absl::Milliseconds(1))))));
  }
  if (begins && job.in_slices) begin_slices(job);
  absl::StatusOr<FrameReport> report = FrameReport{};
  bool ended = true;
  if (job.slices == nullptr) {
    report = render_(job);
  } else {
    try {
      ended = job.slices->run(slice_);
      if (ended) report = *std::move(job.report);
    } catch (const std::system_error&) {
      report = absl::UnavailableError("the server has no thread left for long work; try again soon");
    }
  }
  const absl::Duration ran = clock_.now() - start;
  job.ran += ran;
  {
    absl::MutexLock lock(&mutex_);
    running_ = 0;
    queue_.charge(job.flow, ran);
    if (!ended && !last_slice_) return queue_.put_back(std::move(job));
  }
  if (!ended) {
    job.slices.reset();  // before `done`: waits until the job's thread has released everything
    report = absl::CancelledError("nobody waits for the frame any more");
  }
  finish(std::move(job), std::move(report));
}

void RenderSteps::begin_slices(FrameJob& job) {
  job.report = std::make_shared<absl::StatusOr<FrameReport>>(FrameReport{});
  // The job itself moves between the queue and the render thread.
  auto parts = std::make_shared<FrameJob>();
  parts->frame = job.frame;
  parts->work = job.work;
  parts->decide = std::move(job.decide);
  parts->task = std::move(job.task);
  job.slices =
      std::make_unique<SlicedWork>([this, parts, report = job.report] { *report = render_(*parts); }, clock_);
}

void RenderSteps::finish(FrameJob job, absl::StatusOr<FrameReport> report) {
  if (!report.ok()) return job.done(report.status());
  const absl::Duration queued = clock_.now() - job.submitted - job.ran;
  // A client that reads slowly must not hold the textures.
  if (job.work != Work::kMeter && job.frame != nullptr) job.frame->memory.keep_output_only();
  job.done(RenderedFrame{*std::move(report), queued});
}

}  // namespace candela
