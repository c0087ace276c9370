#include "server/access/refusal_log.h"

#include <utility>

#include "absl/time/clock.h"
#include "server/base/log.h"

namespace candela {
namespace {

constexpr absl::Duration kBetweenLines = absl::Seconds(1);

const char* word(Refusal refusal) { return refusal == Refusal::kNoToken ? "no token" : "unknown token"; }

}  // namespace

void RefusalLog::add(Refusal refusal) {
  uint64_t calls = 0;
  {
    const absl::MutexLock lock(&mutex_);
    Reason& reason = reasons_[static_cast<size_t>(refusal)];
    ++reason.calls;
    const absl::Time now = absl::Now();
    if (now < reason.next) return;
    reason.next = now + kBetweenLines;
    calls = std::exchange(reason.calls, 0);
  }
  log_event(LogLevel::kWarning, "call refused", {{"reason", word(refusal)}, {"calls", calls}});
}

}  // namespace candela
