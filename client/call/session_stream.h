// One Stream call of a session, from its open message to its end.
#pragma once

#include <grpcpp/channel.h>

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/call/duplex_call.h"
#include "client/call/stream_reader.h"
#include "client/security.h"
#include "client/session.h"
#include "client/session_state.h"
#include "server/base/clock.h"

namespace candela {

struct SessionServer {
  std::shared_ptr<grpc::Channel> channel;
  Peer peer;
};

// The end of a call.
struct CallEnd {
  absl::Status status;  // OK: every frame has its result and the session is over
  bool resume = false;  // another call may continue the session
  absl::Duration retry_delay = absl::ZeroDuration();  // how long the server wants to be left alone
  bool progress = false;                              // a result came, or none was due
  bool reached = false;                               // the server, or a proxy before it, took the call
};

// Sends the session's steps to a server and gives the results to `state`. Used by one thread. The arguments
// must outlive it.
class SessionStream {
 public:
  SessionStream(const SessionServer& server, const SessionOptions& options, const std::string& name,
                SessionState& state, Clock& clock);

  // Runs the call to its end; once.
  CallEnd run();

 private:
  v1::StreamRequest open_message(SessionState::Start start) const;
  absl::Status take_event(DuplexCall::Event event);
  absl::Status take_message();
  absl::Time silent_until() const;
  absl::Status hangs() const;
  CallEnd how_it_ended() const;
  void send_next();
  void send_step();
  void send_band();

  const Peer& peer_;
  const SessionOptions& options_;
  const std::string& name_;
  SessionState& state_;
  Clock& clock_;
  DuplexCall duplex_;
  StreamReader reader_;
  v1::StreamRequest open_request_;
  absl::Time open_by_;                           // a server that has not opened the session by then is left
  bool asked_ = false;                           // the open message is out
  bool open_ = false;                            // the server has opened the session
  bool leaving_ = false;                         // the server goes away, so nothing more is sent
  bool closed_ = false;                          // half-closed
  bool answered_ = false;                        // a result came
  bool progress_ = false;                        // see CallEnd
  std::shared_ptr<const SessionFrame> sending_;  // the frame whose bands are being sent
  uint64_t row_ = 0;                             // first row of its next band
  int64_t owed_ = 0;                             // frames that were sent whole and have no result
  absl::Time last_progress_;                     // when a message came, or a write began or ended
};

}  // namespace candela
