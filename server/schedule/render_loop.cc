#include "server/schedule/render_loop.h"

#include <system_error>
#include <utility>

#include "absl/strings/str_format.h"

namespace candela {

namespace {

bool takes_long(const FrameJob& job) {
  return job.task != nullptr || job.frame->long_source || job.frame->memory.takes_long();
}

}  // namespace

RenderLoop::RenderLoop(Render render, size_t capacity, Clock& clock, absl::Duration slice)
    : render_(std::move(render)), clock_(clock), slice_(slice), queue_(capacity), thread_([this] {
        run();
      }) {}

RenderLoop::~RenderLoop() { stop(); }

absl::StatusOr<Ticket> RenderLoop::submit(FrameJob job) {
  job.submitted = clock_.now();
  job.in_slices |= takes_long(job);
  job.ordered &= job.task == nullptr;
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
  if (!job && running_ == ticket) last_slice_ = true;
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
        running_ = job ? job->ticket : 0;
        last_slice_ = false;
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
  const absl::Time start = clock_.now();
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
    job.slices.reset();
    report = absl::CancelledError("nobody waits for the frame any more");
  }
  finish(std::move(job), std::move(report));
}

void RenderLoop::begin_slices(FrameJob& job) {
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

void RenderLoop::finish(FrameJob job, absl::StatusOr<FrameReport> report) {
  if (!report.ok()) return job.done(report.status());
  const absl::Duration queued = clock_.now() - job.submitted - job.ran;
  if (job.work != Work::kMeter && job.frame != nullptr) job.frame->memory.keep_output_only();
  job.done(RenderedFrame{*std::move(report), queued});
}

}  // namespace candela
