#include "server/stream/frame_queue.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_format.h"

namespace candela {

absl::StatusOr<Ticket> FrameQueue::push(FrameJob job) {
  if (jobs_.size() >= capacity_) {
    return absl::UnavailableError(
        absl::StrFormat("%d frames wait already, the most this server queues; try again soon", jobs_.size()));
  }
  jobs_.push_back({next_ticket_, std::move(job)});
  return next_ticket_++;
}

std::optional<FrameJob> FrameQueue::pop() {
  if (jobs_.empty()) return std::nullopt;
  FrameJob job = std::move(jobs_.front().job);
  jobs_.pop_front();
  return job;
}

std::optional<FrameJob> FrameQueue::remove(Ticket ticket) {
  const auto entry =
      std::find_if(jobs_.begin(), jobs_.end(), [ticket](const Entry& e) { return e.ticket == ticket; });
  if (entry == jobs_.end()) return std::nullopt;
  FrameJob job = std::move(entry->job);
  jobs_.erase(entry);
  return job;
}

}  // namespace candela
