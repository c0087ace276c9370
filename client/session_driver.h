// Makes one call of a session after another, until it ends.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/call/memory/session_memory.h"
#include "client/call/retry/retry_schedule.h"
#include "client/call/session_servers.h"
#include "client/call/session_stream.h"
#include "client/session.h"
#include "client/session_state.h"
#include "server/base/clock.h"

namespace candela {

// Used by one thread, and never waits: events go in, calls of `servers` come out, and `state` gets results
// and the end. The arguments must outlive it.
class SessionDriver {
 public:
  // `seed` is the chance in its pauses.
  SessionDriver(SessionServers& servers, const SessionOptions& options, const std::string& name,
                SessionState& state, SessionMemory& memory, Clock& clock, uint32_t seed);

  void start();  // first of all
  // An event of the call that it has, kTimeout at the deadline, or kWoken after SessionState's wake. Nothing
  // after the end.
  void on_event(CallEvent event);
  // The answer to SessionServers::put().
  void on_put(const absl::StatusOr<v1::Environment>& put);

  absl::Time deadline() const;
  bool ended() const { return phase_ == Phase::kEnded; }

 private:
  enum class Phase {
    kIdle,     // no call is needed
    kCalling,  // there is stream_
    kPutting,  // a server is given the panoramas of unput_, the first one now
    kPausing,  // until pause_until_
    kEnded,
  };
  void next_call();
  void end_call();
  bool put_next();
  void call_failed();
  void pause_after_loss();
  void pause_before_open();
  void end_pause();
  void end(const absl::Status& status);

  SessionServers& servers_;
  const SessionOptions& options_;
  const std::string& name_;
  SessionState& state_;
  SessionMemory& memory_;
  Clock& clock_;
  RetrySchedule schedule_;
  Phase phase_ = Phase::kIdle;
  size_t server_ = 0;  // of the current or the last call
  std::unique_ptr<SessionStream> stream_;
  CallEnd last_;          // of the last call
  bool asked_ = false;    // CallEnd.asked of any call
  absl::Status refusal_;  // of the last server that was reached and has not opened the session
  absl::Time open_by_;    // when the first open is given up, once a server was reached
  absl::Time pause_until_;
  absl::Time pause_limit_ = absl::InfiniteFuture();  // when an open session is given up
  std::map<std::string, std::shared_ptr<const Panorama>> unput_;
  std::set<std::string> put_;  // environments that server_ was given since the last call that it answered
};

}  // namespace candela
