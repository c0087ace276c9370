#include "server/schedule/frame_queue.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"

namespace candela {

absl::StatusOr<FrameReport> render_frame(Frame& frame) {
  Renderer& renderer = *frame.renderer;
  if (frame.work != Work::kDraw) {
    absl::StatusOr<Metered> metered = renderer.meter(frame.memory, frame.settings);
    if (!metered.ok()) return metered.status();
    frame.metered = *std::move(metered);
  }
  if (frame.work == Work::kMeter) {
    FrameReport report;
    report.stats = frame.metered->stats;
    report.stages = std::exchange(frame.metered->stages, {});
    return report;
  }
  const FrameStats& stats = frame.metered->stats;
  const Exposed exposed =
      frame.expose ? frame.expose(stats)
                   : expose(frame.settings.exposure, frame.moment.previous, stats.mean_log2_luminance);
  return renderer.draw(frame.memory, frame.settings, frame.moment.sequence, *frame.metered, exposed);
}

absl::StatusOr<Ticket> FrameQueue::push(FrameJob job) {
  if (waiting_ >= capacity_) {
    return absl::UnavailableError(
        absl::StrFormat("%d frames wait already, the most this server queues; try again soon", waiting_));
  }
  Share& share = shares_.try_emplace(job.flow, Share{clock_}).first->second;
  if (share.jobs.empty()) share.used = std::max(share.used, clock_);
  share.jobs.push_back({next_ticket_, std::move(job)});
  ++waiting_;
  return next_ticket_++;
}

std::optional<FrameJob> FrameQueue::pop() {
  if (waiting_ == 0) return std::nullopt;
  auto next = shares_.end();
  for (auto share = shares_.begin(); share != shares_.end();) {
    const Share& candidate = share->second;
    if (candidate.jobs.empty() && candidate.used <= clock_) {
      share = shares_.erase(share);
      continue;
    }
    const auto before = [](const Share& a, const Share& b) {
      return a.used != b.used ? a.used < b.used : a.jobs.front().ticket < b.jobs.front().ticket;
    };
    if (!candidate.jobs.empty() && (next == shares_.end() || before(candidate, next->second))) next = share;
    ++share;
  }
  Share& share = next->second;
  clock_ = std::max(clock_, share.used);
  FrameJob job = std::move(share.jobs.front().job);
  share.jobs.pop_front();
  --waiting_;
  return job;
}

void FrameQueue::charge(Flow flow, absl::Duration time) {
  const auto served = shares_.find(flow);
  if (served == shares_.end()) return;
  served->second.used += time;
  const auto competing = std::count_if(shares_.begin(), shares_.end(), [flow](const auto& entry) {
    return entry.first == flow || !entry.second.jobs.empty();
  });
  clock_ += time / competing;
}

std::optional<FrameJob> FrameQueue::remove(Ticket ticket) {
  for (auto& [flow, share] : shares_) {
    const auto entry = std::find_if(share.jobs.begin(), share.jobs.end(),
                                    [ticket](const Entry& e) { return e.ticket == ticket; });
    if (entry == share.jobs.end()) continue;
    FrameJob job = std::move(entry->job);
    share.jobs.erase(entry);
    --waiting_;
    return job;
  }
  return std::nullopt;
}

}  // namespace candela
