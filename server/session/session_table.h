// The sessions that are open, by name.
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

  // The server stops: what has no result yet will not get one here, but for what is already decided.
  virtual void go_away() = 0;
  // Another call goes on with the session.
  virtual void give_up() = 0;
};

// Any thread. Calls no SessionCall itself.
class SessionTable {
 public:
  // Enters a session that `call` carries. ALREADY_EXISTS where another call has it, unless `resumed` with an
  // epoch that is not older: then that call is given back, to be told to give up, or null where there was
  // none. FAILED_PRECONDITION for an older epoch.
  absl::StatusOr<std::shared_ptr<SessionCall>> enter(const std::string& session, uint64_t epoch, bool resumed,
                                                     std::shared_ptr<SessionCall> call);
  // Nothing where another call has taken the session over.
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
