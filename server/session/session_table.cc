#include "server/session/session_table.h"

#include <utility>

#include "absl/strings/str_format.h"

namespace candela {

absl::StatusOr<std::shared_ptr<SessionCall>> SessionTable::enter(const std::string& session, uint64_t epoch,
                                                                 bool resumed,
                                                                 std::shared_ptr<SessionCall> call) {
  absl::MutexLock lock(&mutex_);
  std::shared_ptr<SessionCall> before;
  if (const auto entry = sessions_.find(session); entry != sessions_.end()) {
    if (!resumed) {
      return absl::AlreadyExistsError(absl::StrFormat(
          "session '%s' is open on another call; choose another name, or go on with its resume token",
          session));
    }
    // An equal one has the last token, too: results of the other call did not reach its client.
    if (epoch < entry->second.epoch) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "session '%s' was resumed since this token was given; use the last token received", session));
    }
    before = entry->second.call.lock();
  }
  const SessionCall* key = call.get();
  sessions_[session] = {epoch, std::move(call), key};
  return before;
}

void SessionTable::leave(const std::string& session, const SessionCall* call) {
  absl::MutexLock lock(&mutex_);
  const auto entry = sessions_.find(session);
  if (entry != sessions_.end() && entry->second.key == call) sessions_.erase(entry);
}

std::vector<std::shared_ptr<SessionCall>> SessionTable::all() const {
  absl::MutexLock lock(&mutex_);
  std::vector<std::shared_ptr<SessionCall>> calls;
  for (const auto& [session, entry] : sessions_) {
    if (std::shared_ptr<SessionCall> call = entry.call.lock()) calls.push_back(std::move(call));
  }
  return calls;
}

}  // namespace candela
