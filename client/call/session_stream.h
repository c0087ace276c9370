// One Stream call of a session, from its open message to its end.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/call/client_call.h"
#include "client/call/link_pace.h"
#include "client/call/memory/session_memory.h"
#include "client/call/stream_reader.h"
#include "client/session.h"
#include "client/session_state.h"
#include "proto/candela/v1/zstd_rows.h"
#include "server/base/clock.h"

namespace candela {

// The end of a call.
struct CallEnd {
  absl::Status status;  // OK: every frame has its result and the session is over
  bool resume = false;  // another call may continue the session
  absl::Duration retry_delay = absl::ZeroDuration();  // how long the server wants to be left alone
  bool progress = false;                              // a result came, or none was due
  bool reached = false;                               // the server, or a proxy before it, took the call
  bool asked = false;                                 // the server may have opened the session
};

// Sends the session's steps to a server and gives the results to `state`. Used by one thread, and never
// waits. The references must outlive it.
class SessionStream {
 public:
  // `call` has just begun, at the server with this `address`. `asked_before`: CallEnd.asked of an earlier
  // call.
  SessionStream(std::unique_ptr<ClientCall> call, const std::string& address, bool asked_before,
                SessionState::Start start, const SessionOptions& options, const std::string& name,
                SessionState& state, SessionMemory& memory, Clock& clock);

  // Takes the next event, up to kEnded.
  void on_event(CallEvent event);
  // When kTimeout is due.
  absl::Time deadline() const;
  // After kEnded: how the call ended.
  CallEnd end() const;

 private:
  v1::StreamRequest open_message(SessionState::Start start, const std::string& name) const;
  absl::Status take_event(CallEvent event);
  absl::Status take_message();
  absl::Time silent_until() const;
  absl::Status hangs() const;
  CallEnd how_it_ended() const;
  void send_next();
  void send_step();
  bool place(const SessionStep& step, v1::FrameHeader& header);
  DueFrame due_frame() const;
  void send_band();
  grpc::ByteBuffer next_band();

  const std::unique_ptr<ClientCall> call_;
  const std::string& address_;
  const SessionOptions& options_;
  SessionState& state_;
  SessionMemory& memory_;
  Clock& clock_;
  StreamReader reader_;
  const bool asked_before_;
  const v1::StreamRequest open_request_;
  const absl::Time open_by_;                     // when to leave a server that has not opened the session
  bool asked_ = false;                           // the open message is out
  bool open_ = false;                            // the server has opened the session
  bool leaving_ = false;                         // the server goes away, so nothing more is sent
  bool closed_ = false;                          // half-closed
  bool answered_ = false;                        // a result came
  bool progress_ = false;                        // see CallEnd
  std::shared_ptr<const SessionFrame> sending_;  // the frame whose bands are being sent
  uint64_t row_ = 0;                             // first row of its next band
  uint64_t band_ = 0;                            // the number of its next band
  absl::Time band_began_;                        // when the one before it was written
  bool server_unpacks_ = false;                  // the server takes compressed bands
  bool compress_ = false;                        // those of this frame
  LinkPace pace_;
  std::optional<v1::RowPacker> packer_;                         // from the first frame on that is compressed
  std::deque<std::pair<uint64_t, SharedRegion::Area>> images_;  // of frames that were sent, by their numbers
  bool shared_ = false;                                         // a frame was placed in memory
  int64_t owed_ = 0;          // frames that were sent whole and have no result
  absl::Time last_progress_;  // when a message came, or a write began or ended
  CallEnd own_;               // why this side ended the call; OK: it has not
};

}  // namespace candela
