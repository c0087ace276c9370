// A table of the open sessions, by name.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"

namespace candela {

// A call that carries a session. Any thread.
class SessionCall {
 public:
  virtual ~SessionCall() = default;

  // The server drains: no more frames are taken, and those that can be answered still are.
  virtual void go_away() = 0;
  // Another call resumed the session: ends at once.
  virtual void give_up() = 0;
};

// Any thread. Never calls a SessionCall.
class SessionTable {
 public:
  // Enters a session for `call`. If another call has the session and this one is `resumed` with an epoch that
  // is not older, returns the other call, which the caller tells to give up; returns null if there is none.
  // ALREADY_EXISTS if another call has the session and this one is not resumed. FAILED_PRECONDITION for an
  // older epoch.
  absl::StatusOr<std::shared_ptr<SessionCall>> enter(const std::string& session, uint64_t epoch, bool resumed,
                                                     std::shared_ptr<SessionCall> call);
  // Does nothing if another call has taken the session over.
  void leave(const std::string& session, const SessionCall* call);

  std::vector<std::shared_ptr<SessionCall>> all() const;

 private:
  struct Entry {
    uint64_t epoch;
    std::weak_ptr<SessionCall> call;
    const SessionCall* key;
  };

  mutable absl::Mutex mutex_;
  std::map<std::string, Entry> sessions_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace candela
