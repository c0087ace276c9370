#include "server/session/sessions.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "server/base/check.h"
#include "server/base/status_macros.h"

namespace candela {

absl::Status CallGate::enter() {
  absl::MutexLock lock(&mutex_);
  if (closed_) {
    return absl::UnavailableError(
        absl::StrFormat("server is draining and takes no new %s; use another one", what_));
  }
  if (places_taken_ >= max_calls_) {
    return absl::UnavailableError(
        absl::StrFormat("server has %d %s, which is its limit; try again soon", places_taken_, what_));
  }
  ++places_taken_;
  ++inside_;
  return absl::OkStatus();
}

void CallGate::give_up_place() {
  absl::MutexLock lock(&mutex_);
  CHECK(places_taken_ > 0);
  --places_taken_;
}

void CallGate::leave() {
  std::function<void()> then;
  {
    absl::MutexLock lock(&mutex_);
    CHECK(inside_ > 0);
    if (--inside_ == 0) then = std::exchange(on_empty_, nullptr);
  }
  if (then) then();
}

void CallGate::close() {
  absl::MutexLock lock(&mutex_);
  closed_ = true;
}

uint32_t CallGate::places_taken() const {
  absl::MutexLock lock(&mutex_);
  return places_taken_;
}

bool CallGate::closed() const {
  absl::MutexLock lock(&mutex_);
  return closed_;
}

void CallGate::when_empty(std::function<void()> then) {
  {
    absl::MutexLock lock(&mutex_);
    CHECK(closed_);
    if (inside_ > 0) {
      on_empty_ = std::move(then);
      return;
    }
  }
  then();
}

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

absl::StatusOr<OpenedSession> open_session(const v1::StreamOpen& open, absl::Time now, Sessions& sessions,
                                           std::shared_ptr<SessionCall> call) {
  OpenedSession session;
  ASSIGN_OR_RETURN(session.start, stream_start_from(open));
  if (session.start.state) session.point.exposure = *session.start.state;
  session.resumed = !session.start.resume_token.empty();
  if (session.resumed) {
    ASSIGN_OR_RETURN(session.point,
                     sessions.keys.open(session.start.resume_token, session.start.session, now));
    if (session.point.settings_hash != session.start.settings.hash) {
      return absl::FailedPreconditionError(
          "resume_token belongs to a result with other settings; open the session with those settings and "
          "change them afterwards");
    }
    session.epoch = session.point.epoch + 1;
  }
  ASSIGN_OR_RETURN(session.previous, sessions.table.enter(session.start.session, session.epoch,
                                                          session.resumed, std::move(call)));
  return session;
}

}  // namespace candela
