#include "server/session/sessions.h"

#include <utility>

#include "server/base/status_macros.h"

namespace candela {

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
