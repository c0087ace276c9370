// The open sessions of a server and the state that they share.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "server/schedule/frame_queue.h"
#include "server/session/limits/client_memory.h"
#include "server/session/resume_token.h"
#include "server/session/session_table.h"
#include "server/session/stream_start.h"

namespace candela {

// Any thread.
struct Sessions {
  const TokenKeys keys;
  const std::shared_ptr<ClientMemory> memory;
  SessionTable table{};
  std::atomic<Flow> next_flow{1};  // odd numbers are sessions, even ones are clients
};

struct OpenedSession {
  StreamStart start;
  uint64_t epoch = 0;  // 0, and one more each time the session is resumed
  bool resumed = false;
  ResumePoint point;  // if not resumed, only its exposure counts: the default, or the state that was given
  // The last frame whose exposure the resumed session knows; none if it is not resumed.
  std::optional<uint64_t> resumed_at() const {
    return resumed && point.exposure.begun ? std::optional(point.exposure.sequence) : std::nullopt;
  }
  std::shared_ptr<SessionCall> previous;  // the call that had this session until now; null if none
};

// Checks the request and its resume token, and enters the session into the table for `call`. Fails as
// stream_start_from, TokenKeys::open and SessionTable::enter do, and with FAILED_PRECONDITION if the settings
// are not those of the token. The caller tells `previous` to give up.
absl::StatusOr<OpenedSession> open_session(const v1::StreamOpen& open, absl::Time now, Sessions& sessions,
                                           std::shared_ptr<SessionCall> call);

}  // namespace candela
