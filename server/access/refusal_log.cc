#include "server/access/refusal_log.h"

#include <optional>

#include "server/base/log.h"

namespace candela {
namespace {

const char* word(Refusal refusal) { return refusal == Refusal::kNoToken ? "no token" : "unknown token"; }

}  // namespace

void RefusalLog::add(Refusal refusal, absl::FunctionRef<std::string()> peer) {
  std::optional<uint64_t> calls;
  {
    const absl::MutexLock lock(&mutex_);
    calls = reasons_[static_cast<size_t>(refusal)].pass(clock_.now());
  }
  if (!calls) return;
  log_event(LogLevel::kWarning, "call refused",
            {{"reason", word(refusal)}, {"peer", peer()}, {"calls", *calls}});
}

}  // namespace candela
