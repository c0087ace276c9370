#include "server/session/drain.h"

#include <utility>

namespace candela {

std::shared_ptr<Drain> Drain::begin(CallGate& calls, CallGate& sessions, const SessionTable& table,
                                    Ended ended) {
  std::shared_ptr<Drain> drain(new Drain(std::move(ended)));
  calls.close();
  sessions.close();
  for (const std::shared_ptr<SessionCall>& session : table.all()) session->go_away();
  for (CallGate* gate : {&calls, &sessions}) gate->when_empty([drain] { drain->on_empty(); });
  return drain;
}

void Drain::on_empty() {
  const absl::MutexLock lock(&mutex_);
  if (--gates_ == 0) end(true);
}

void Drain::on_time() {
  const absl::MutexLock lock(&mutex_);
  end(false);
}

void Drain::end(bool drained) {
  if (ended_) std::exchange(ended_, nullptr)(drained);
}

}  // namespace candela
