#include "server/schedule/frame_queue.h"

#include <algorithm>
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

}  // namespace candela
