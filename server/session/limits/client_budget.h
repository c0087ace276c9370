// A budget that clients share, so that no client takes what all others need.
#pragma once

#include <cstdint>
#include <map>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"

namespace candela {

// Identifies a client; see server/access/client_identity.h.
using ClientId = uint64_t;

// The clients that have a call at the moment. Any thread.
class ClientPresence {
 public:
  // A call of a client, from construction to destruction. The presence outlives it.
  class Visit {
   public:
    Visit(ClientPresence& presence, ClientId client);
    ~Visit();
    Visit(const Visit&) = delete;
    Visit& operator=(const Visit&) = delete;

   private:
    ClientPresence& presence_;
    const ClientId client_;
  };

  // Whether no other client has a call.
  bool alone(ClientId client) const;

 private:
  mutable absl::Mutex mutex_;
  std::map<ClientId, uint64_t> calls_ ABSL_GUARDED_BY(mutex_);
};

// While other clients are present, a client may hold `percent` of what the others leave of the budget. So
// some of it stays free for the next client, whatever the present ones want. (A. Choudhury and E. Hahne,
// "Dynamic queue length thresholds for shared-memory packet switches", 1998.) Two exceptions keep every
// client going: one that holds nothing may take whatever fits, and one that is alone has no share. Any
// thread.
class ClientBudget {
 public:
  enum class Answer { kGranted, kNoRoom, kOverShare };

  // `bytes` is at most 2^56 and `percent` 1 .. 100. `presence` outlives the budget.
  ClientBudget(uint64_t bytes, uint32_t percent, const ClientPresence& presence)
      : budget_bytes_(bytes), percent_(percent), presence_(presence) {}

  // Changes a part of what `client` holds from `before` to `bytes`. Less is always granted. The client's
  // share is at least `least_share`. Changes nothing unless it answers kGranted.
  Answer change(ClientId client, uint64_t before, uint64_t bytes, uint64_t least_share = 0);

  uint64_t budget_bytes() const { return budget_bytes_; }
  uint64_t held() const;  // by all clients
  uint64_t held(ClientId client) const;
  // What the client may hold while others are present.
  uint64_t share(ClientId client) const;

 private:
  uint64_t held_by(ClientId client) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  uint64_t share_of(ClientId client) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const uint64_t budget_bytes_;
  const uint32_t percent_;
  const ClientPresence& presence_;
  mutable absl::Mutex mutex_;
  uint64_t held_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<ClientId, uint64_t> clients_ ABSL_GUARDED_BY(mutex_);  // that hold something
};

}  // namespace candela
