// The log of a session: the submitted frames and settings changes that have no result yet. With the last
// resume token it is enough to continue the session on any server.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/session.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// One step of a session: a frame or a change of settings.
struct SessionStep {
  std::shared_ptr<const SessionFrame> frame;  // null: a change
  absl::Time submitted;                       // when the frame was submitted
  v1::ImageSize image;                        // of the frame, as its settings ask for
  uint64_t from_sequence = 0;                 // first frame of the change
  v1::Settings settings;                      // settings of the change
  uint64_t image_bytes = 0;                   // of the frame's image; 0: it does not come as pixels
};

// Not thread-safe.
class SessionLog {
 public:
  // `state`, if there is one, is that of the frame before the first.
  // `raw`: images come as pixels.
  explicit SessionLog(v1::Settings settings, const std::optional<v1::SessionState>& state = std::nullopt,
                      bool raw = true);

  // Add a step. They fail like Session::submit() and Session::change_settings().
  absl::Status add(SessionFrame frame, absl::Time now);
  absl::Status change(uint64_t from_sequence, const v1::Settings& settings);

  // The contents of a call's open message: the last token, or empty, and the settings at that point.
  const std::string& token() const { return token_; }
  const v1::Settings& settings() const { return settings_; }

  // A call begins, and every step in the log is to be sent on it. Returns how many frames earlier calls had
  // sent.
  uint64_t rewind();

  // The next step to send, in order, or null if all have been sent. The step stays in the log.
  const SessionStep* next();

  // The frame whose result is due: the first in the log, if it has been sent. Null if no result is due.
  const SessionStep* due() const;

  // The due frame has its result, which came with `token`, or empty without one. The frame leaves the log,
  // and so do the changes that the token covers.
  void answered(const std::string& token);

  // Of the image of a frame of this size that is added next; 0 if it does not come as pixels.
  uint64_t image_bytes(v1::ImageSize frame) const;

  uint64_t unanswered() const { return unanswered_; }

  // The panoramas of the views that have no result yet, by the ids of their environments.
  std::map<std::string, std::shared_ptr<const Panorama>> panoramas() const;

 private:
  std::deque<SessionStep>::const_iterator first_frame() const;
  // Of the frame after all steps.
  const v1::Settings& settings_of(uint64_t sequence) const;
  uint64_t image_bytes(const v1::Settings& settings, v1::ImageSize image) const;

  const bool raw_;
  v1::Settings settings_;
  std::string token_;
  std::deque<SessionStep> steps_;
  size_t given_ = 0;                       // steps at the front that were sent on this call
  uint64_t unanswered_ = 0;                // frames in steps_
  std::optional<uint64_t> last_sequence_;  // of the last frame submitted
  int64_t last_time_ns_ = 0;
  uint64_t last_from_ = 0;  // of the last change
};

}  // namespace candela
