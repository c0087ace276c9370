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
          "session '%s' is open on another call; choose another name, or resume it with its token", session));
    }
    // An equal epoch means that the client has the last token: no result of the other call reached it.
    if (epoch < entry->second.epoch) {
      return absl::FailedPreconditionError(absl::StrFormat(
          "session '%s' was resumed after this token was issued; use the last token received", session));
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
