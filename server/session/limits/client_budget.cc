#include "server/session/limits/client_budget.h"

#include <algorithm>

#include "server/base/check.h"

namespace candela {

ClientPresence::Visit::Visit(ClientPresence& presence, ClientId client)
    : presence_(presence), client_(client) {
  absl::MutexLock lock(&presence_.mutex_);
  ++presence_.calls_[client_];
}

ClientPresence::Visit::~Visit() {
  absl::MutexLock lock(&presence_.mutex_);
  const auto calls = presence_.calls_.find(client_);
  CHECK(calls != presence_.calls_.end());
  if (--calls->second == 0) presence_.calls_.erase(calls);
}

bool ClientPresence::alone(ClientId client) const {
  absl::MutexLock lock(&mutex_);
  return calls_.empty() || (calls_.size() == 1 && calls_.begin()->first == client);
}

ClientBudget::Answer ClientBudget::change(ClientId client, uint64_t before, uint64_t bytes,
                                          uint64_t least_share) {
  const bool alone = presence_.alone(client);
  absl::MutexLock lock(&mutex_);
  if (bytes > before) {
    const uint64_t more = bytes - before;
    if (held_ > budget_bytes_ || more > budget_bytes_ - held_) return Answer::kNoRoom;
    const uint64_t holds = held_by(client);
    const uint64_t share = std::max(share_of(client), least_share);
    if (!alone && holds > 0 && holds + more > share) return Answer::kOverShare;
  }
  CHECK(held_ >= before);
  held_ = held_ - before + bytes;
  uint64_t& holds = clients_[client];
  CHECK(holds >= before);
  holds = holds - before + bytes;
  if (holds == 0) clients_.erase(client);
  return Answer::kGranted;
}

uint64_t ClientBudget::held() const {
  absl::MutexLock lock(&mutex_);
  return held_;
}

uint64_t ClientBudget::held(ClientId client) const {
  absl::MutexLock lock(&mutex_);
  return held_by(client);
}

uint64_t ClientBudget::share(ClientId client) const {
  absl::MutexLock lock(&mutex_);
  return share_of(client);
}

uint64_t ClientBudget::held_by(ClientId client) const {
  const auto found = clients_.find(client);
  return found == clients_.end() ? 0 : found->second;
}

uint64_t ClientBudget::share_of(ClientId client) const {
  const uint64_t by_others = held_ - held_by(client);
  return (budget_bytes_ - std::min(budget_bytes_, by_others)) * percent_ / 100;
}

}  // namespace candela
