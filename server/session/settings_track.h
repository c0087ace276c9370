// A session's settings, and the changes that are scheduled for later frames.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/session/stream_start.h"

namespace candela {

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
