// Who gets memory: a budget that clients share, so that no client takes what all others need, and the rules
// by which frames wait, yield and are refused.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"
#include "server/render/frame/frame_memory.h"

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

// The smallest frames that lately found no memory. A frame counts for kLasts after its last attempt, which is
// longer than a refused client waits before its next one. Any thread.
class MemoryPressure {
 public:
  static constexpr absl::Duration kLasts = absl::Seconds(2);

  // A frame of `bytes` found no memory: in the budget, or only in the share of client `within`.
  void wanted(uint64_t bytes, std::optional<ClientId> within, absl::Time now);
  // A frame of `bytes` of `client` has its memory.
  void granted(uint64_t bytes, ClientId client);

  // The smallest frame that waits for room in the budget.
  std::optional<uint64_t> smallest(absl::Time now) const;
  // The smallest frame that `client` could make room for.
  std::optional<uint64_t> smallest(ClientId client, absl::Time now) const;

 private:
  struct Wanted {
    uint64_t bytes = 0;
    absl::Time until = absl::InfinitePast();
  };
  mutable absl::Mutex mutex_;
  Wanted in_budget_ ABSL_GUARDED_BY(mutex_);
  std::map<ClientId, Wanted> in_share_ ABSL_GUARDED_BY(mutex_);
};

// Budgets: they count bytes, and allocate none. There is one for frames and the regions that clients share,
// one for the look-ahead that sessions are promised, and one for the colour tables in changes of settings.
// Any thread. What it hands out keeps it alive.
class ClientMemory : public std::enable_shared_from_this<ClientMemory> {
 public:
  // An upload that gets no band for this long loses its memory if another frame could use it.
  static constexpr absl::Duration kStalled = absl::Seconds(2);

  // How often a call that uploads calls check_upload().
  static constexpr absl::Duration kLookInterval = absl::Milliseconds(500);

  // `budget_bytes` is the texture pool's, `percent` a client's share (see ClientBudget), and `slow_upload`
  // the time after which an upload that is not complete loses its memory if another frame could use it.
  ClientMemory(uint64_t budget_bytes, uint32_t percent, absl::Duration slow_upload);

  // Counts a frame of `bytes`. UNAVAILABLE if the budget or the client's share has no room now, or if a
  // smaller frame waits for the rest.
  absl::StatusOr<std::unique_ptr<MemoryClaim>> claim_frame(ClientId client, uint64_t bytes, absl::Time now);
  // The device's pool had no room for a frame that was counted.
  void found_no_texture(uint64_t bytes, absl::Time now) { pressure_.wanted(bytes, std::nullopt, now); }

  // Changes a session's promise from `before` to `bytes`. UNAVAILABLE if there is no room for it now.
  absl::Status promise_lookahead(ClientId client, uint64_t before, uint64_t bytes);
  uint64_t budget_bytes() const { return frames_.budget_bytes(); }
  uint64_t frames_bytes() const { return frames_.held(); }  // of all clients

  // Counts a colour table of `bytes` until the result is destroyed. UNAVAILABLE if there is no room for it.
  absl::StatusOr<std::shared_ptr<const void>> claim_table(ClientId client, uint64_t bytes);

  // Counts a region of `bytes` that a client shares, in the budget of frames, until the result is destroyed.
  // All regions together take at most a quarter of it, because nothing takes them back for a frame that
  // waits. RESOURCE_EXHAUSTED if it is larger, UNAVAILABLE if there is no room for it now.
  absl::StatusOr<std::shared_ptr<const void>> claim_region(ClientId client, uint64_t bytes);

  // UNAVAILABLE if an upload of `client` has to give its `bytes` to a frame that waits. `taken` is the time
  // since the upload began, and `silent` the time since its last band.
  absl::Status check_upload(ClientId client, uint64_t bytes, absl::Duration taken, absl::Duration silent,
                            absl::Time now) const;

  ClientPresence& presence() { return presence_; }

 private:
  class FrameClaim;
  absl::Status over_share(const ClientBudget& budget, ClientId client, uint64_t bytes,
                          const char* what) const;

  const absl::Duration slow_upload_;
  ClientPresence presence_;
  ClientBudget frames_;
  ClientBudget lookahead_;
  ClientBudget tables_;
  ClientBudget regions_;  // counted in frames_, too
  MemoryPressure pressure_;
};

}  // namespace candela
