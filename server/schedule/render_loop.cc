#include "server/schedule/render_loop.h"

#include <algorithm>
#include <system_error>
#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

absl::StatusOr<FrameReport> render_frame(const FrameJob& job) {
  Frame& frame = *job.frame;
  FrameMaker& renderer = *frame.renderer;
  if (job.work != Work::kDraw) {
    std::vector<StageTime> stages = std::exchange(frame.stages, {});
    if (frame.source) {
      const HostStage view("view", &stages);
      RETURN_IF_ERROR(frame.source(frame.memory));
    }
    ASSIGN_OR_RETURN(frame.metered, renderer.meter(frame.memory, frame.settings));
    frame.metered->stages.insert(frame.metered->stages.begin(), stages.begin(), stages.end());
  }
  if (job.work == Work::kMeter) {
    FrameReport report;
    report.stats = frame.metered->stats;
    report.stages = std::exchange(frame.metered->stages, {});
    return report;
  }
  const Exposed exposed = job.decide(frame.metered->stats);
  return renderer.draw(frame.memory, frame.settings, frame.sequence, *frame.metered, exposed);
}

absl::StatusOr<FrameReport> run_job(const FrameJob& job) {
  if (!job.task) return render_frame(job);
  RETURN_IF_ERROR(job.task());
  return FrameReport{};
}

absl::StatusOr<Ticket> FrameQueue::push(FrameJob job) {
  if (waiting_ >= capacity_) {
    return absl::UnavailableError(
        absl::StrFormat("the queue is full with %d waiting frames; try again soon", waiting_));
  }
  Share& share = shares_.try_emplace(job.flow, Share{clock_}).first->second;
  // A flow that paused must not catch up on the time that it did not use.
  if (share.jobs.empty()) share.used = std::max(share.used, clock_);
  job.ticket = next_ticket_;
  share.jobs.push_back(std::move(job));
  ++waiting_;
  return next_ticket_++;
}

std::optional<FrameJob> FrameQueue::pop() {
  if (waiting_ == 0) return std::nullopt;
  auto next = shares_.end();
  absl::Duration least = absl::InfiniteDuration();
  for (auto share = shares_.begin(); share != shares_.end();) {
    const Share& candidate = share->second;
    // A new flow begins at clock_, so this one gains nothing by being forgotten.
    if (candidate.jobs.empty() && candidate.used <= clock_) {
      share = shares_.erase(share);
      continue;
    }
    const auto before = [](const Share& a, const Share& b) {
      // The ends of the jobs count: of two flows that have used the same, the one with the shorter job is
      // next.
      const absl::Duration a_end = a.used + a.last, b_end = b.used + b.last;
      return a_end != b_end ? a_end < b_end : a.jobs.front().ticket < b.jobs.front().ticket;
    };
    if (!candidate.jobs.empty()) {
      least = std::min(least, candidate.used);
      if (next == shares_.end() || before(candidate, next->second)) next = share;
    }
    ++share;
  }
  CHECK(next != shares_.end() && !next->second.jobs.empty());
  Share& share = next->second;
  clock_ = std::max(clock_, least);
  FrameJob job = std::move(share.jobs.front());
  share.jobs.pop_front();
  --waiting_;
  return job;
}

void FrameQueue::put_back(FrameJob job) {
  std::deque<FrameJob>& jobs = shares_.try_emplace(job.flow, Share{clock_}).first->second.jobs;
  jobs.insert(job.ordered ? jobs.begin() : jobs.end(), std::move(job));
  ++waiting_;
}

void FrameQueue::charge(Flow flow, absl::Duration time) {
  charge_elsewhere(flow, time);
  shares_.at(flow).last = time;
}

void FrameQueue::charge_elsewhere(Flow flow, absl::Duration time) {
  time = std::max(time, absl::ZeroDuration());  // a machine's clock may be set back
  shares_.try_emplace(flow, Share{clock_}).first->second.used += time;
  // A flow that always has jobs waiting gets this part of the time, and the clock is its account.
  const auto competing = std::count_if(shares_.begin(), shares_.end(), [flow](const auto& entry) {
    return entry.first == flow || !entry.second.jobs.empty();
  });
  CHECK(competing > 0);
  clock_ += time / competing;
}

std::optional<FrameJob> FrameQueue::remove(Ticket ticket) {
  for (auto& [flow, share] : shares_) {
    const auto entry = std::find_if(share.jobs.begin(), share.jobs.end(),
                                    [ticket](const FrameJob& j) { return j.ticket == ticket; });
    if (entry == share.jobs.end()) continue;
    FrameJob job = std::move(*entry);
    share.jobs.erase(entry);
    CHECK(waiting_ > 0);
    --waiting_;
    return job;
  }
  return std::nullopt;
}

void count_stages(Metrics& metrics, const RenderedFrame& rendered) {
  metrics.stage("queue", rendered.queued);
  for (const StageTime& stage : rendered.report.stages)
    metrics.stage(stage.name, absl::Nanoseconds(stage.ns));
}

std::optional<Rejection> rejection_of(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kAlreadyExists:
      return Rejection::kRequest;
    case absl::StatusCode::kResourceExhausted:
      return Rejection::kSize;
    case absl::StatusCode::kUnavailable:
      return Rejection::kMemory;
    default:
      return std::nullopt;
  }
}

std::optional<Rejection> rejection_at_open(const absl::Status& status) {
  if (absl::IsFailedPrecondition(status)) return Rejection::kToken;
  if (absl::IsUnavailable(status)) return Rejection::kDraining;
  return rejection_of(status);
}

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

RenderLoop::RenderLoop(Render render, size_t capacity, Clock& clock, absl::Duration slice)
    : RenderSteps(std::move(render), capacity, clock, slice), thread_([this] {
        while (wait()) step();
      }) {}

RenderLoop::~RenderLoop() { stop(); }

void RenderLoop::stop() {
  close();
  if (thread_.joinable()) thread_.join();
}

}  // namespace candela
