// The open message of a stream, checked.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/render/settings/settings.h"
#include "server/session/exposure_track.h"

namespace candela {

// The settings of a session's frames, and the hash that identifies them in a resume token.
struct SessionSettings {
  Settings settings;
  std::string hash;
};

struct StreamStart {
  std::string session;
  SessionSettings settings;
  std::string resume_token;  // empty: a new session
  uint32_t lookahead = 0;
  double cut_threshold_ev = 0.0;  // 0: cuts are not detected
  v1::Encoding encoding = v1::ENCODING_RAW;
  int jpeg_quality = 90;
  std::optional<ExposurePoint> state;  // a new session continues after it
  bool return_state = false;

  // The frames are rendered; otherwise they are only metered.
  bool draws() const { return encoding != v1::ENCODING_NONE; }
};

// INVALID_ARGUMENT with the field, its value and its range.
absl::StatusOr<StreamStart> stream_start_from(const v1::StreamOpen& open);

// Fails as settings_from does, and with INVALID_ARGUMENT if the encoding cannot hold the output format.
absl::StatusOr<SessionSettings> session_settings_from(const v1::Settings& message, v1::Encoding encoding);

// A session's settings, and the changes that are scheduled for later frames.
//
// Holds the settings of the newest frame and the changes that later frames bring. Not thread-safe.
class SettingsTrack {
 public:
  // Counts a colour table of so many bytes as long as the result lives, or fails if there is no room for it.
  using ClaimTable = std::function<absl::StatusOr<std::shared_ptr<const void>>(uint64_t bytes)>;

  // The settings before the first frame. `claim_table` counts the memory of each change's table before the
  // change is stored.
  SettingsTrack(SessionSettings opened, v1::Encoding encoding, ClaimTable claim_table);

  // Continues after frame `sequence` of another call.
  void resume(uint64_t sequence) { last_sequence_ = sequence; }

  // Schedules a change. The later of two changes for the same frame counts. INVALID_ARGUMENT if that frame
  // came already or v1::kMaxPendingChanges are pending; otherwise fails as session_settings_from and as
  // claiming its table do.
  absl::Status add(const v1::SettingsChange& change);

  // Moves on to frame `sequence`.
  void advance(uint64_t sequence);

  const SessionSettings& now() const { return now_; }

 private:
  SessionSettings now_;
  const v1::Encoding encoding_;
  const ClaimTable claim_table_;
  std::optional<uint64_t> last_sequence_;
  std::map<uint64_t, SessionSettings> changes_;  // by the first frame that has them
};

}  // namespace candela
