#include "client/call/retry/retry_schedule.h"

#include <algorithm>

#include "server/base/check.h"

namespace candela {
namespace {

constexpr absl::Duration kFirstPause = absl::Milliseconds(50);
constexpr absl::Duration kLongestPause = absl::Seconds(1);
constexpr double kMostJitter = 0.5;

}  // namespace

void RetrySchedule::failed(absl::Time now, absl::Duration delay, bool progress) {
  const size_t servers = not_before_.size();
  CHECK(next_ < servers && delay >= absl::ZeroDuration());
  const auto jittered = [this](absl::Duration pause) {
    return pause * std::uniform_real_distribution<>(1, 1 + kMostJitter)(random_);
  };
  attempts_ = progress ? 1 : attempts_ + 1;
  not_before_[next_] = now + jittered(delay);
  next_ = (next_ + 1) % servers;
  when_ = now;
  if (attempts_ > 1 && attempts_ % servers == 0) {
    const size_t rounds = std::min<size_t>(attempts_ / servers - 1, 10);
    when_ += jittered(std::min(kLongestPause, kFirstPause * (int64_t{1} << rounds)));
  }
  when_ = std::max(when_, not_before_[next_]);
  CHECK(when_ >= now);
}

}  // namespace candela
