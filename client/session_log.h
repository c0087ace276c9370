// What a session has submitted and is not done with: enough to go on from the last token on any server.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/session.h"

namespace candela {

// One step of a session: a frame or a change of settings.
struct SessionStep {
  std::shared_ptr<const SessionFrame> frame;  // null: a change
  absl::Time submitted;                       // the frame
  uint64_t from_sequence = 0;                 // the change
  v1::Settings settings;                      // the change
};

// Not thread-safe.
class SessionLog {
 public:
  explicit SessionLog(v1::Settings settings) : settings_(std::move(settings)) {}

  // As Session's submit() and change_settings() say.
  absl::Status add(SessionFrame frame, absl::Time now);
  absl::Status change(uint64_t from_sequence, const v1::Settings& settings);

  // What a call opens with: the last token, empty for none, and the settings as they were then.
  const std::string& token() const { return token_; }
  const v1::Settings& settings() const { return settings_; }

  // A call begins: every step that is left is to be sent on it. Gives how many frames were sent before.
  uint64_t rewind();

  // The next step to send, in order; none when all were given out. It stays in the log.
  const SessionStep* next();

  // The first frame without a result, if it was given out: the one whose result is due. Null: none is.
  const SessionStep* due() const;

  // The due frame has its result, which came with this token (empty: none). It leaves the log, and with it
  // the changes that the token covers.
  void answered(const std::string& token);

  uint64_t unanswered() const { return unanswered_; }

 private:
  std::deque<SessionStep>::const_iterator first_frame() const;

  v1::Settings settings_;
  std::string token_;
  std::deque<SessionStep> steps_;
  size_t given_ = 0;                       // steps from the front that were given out on this call
  uint64_t unanswered_ = 0;                // frames in steps_
  std::optional<uint64_t> last_sequence_;  // of the last frame submitted
  int64_t last_time_ns_ = 0;
  uint64_t last_from_ = 0;  // of the last change
};

}  // namespace candela
