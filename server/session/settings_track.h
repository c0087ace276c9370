// A session's settings, and the changes that are scheduled for later frames.
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
#include "server/render/settings/tier_choice.h"
#include "server/schedule/image_file.h"
#include "server/session/stream_start.h"

namespace candela {

// Holds the settings of the newest frame, the tier that max_ms has chosen, and
// the changes that later frames bring. Not thread-safe.
class SettingsTrack {
 public:
  // Counts a colour table of so many bytes as long as the result lives, or fails if there is no room for it.
  using ClaimTable = std::function<absl::StatusOr<std::shared_ptr<const void>>(uint64_t bytes)>;

  // The settings before the first frame. The table of every change is claimed before it is kept.
  SettingsTrack(SessionSettings opened, v1::Encoding encoding, ClaimTable claim_table);

  // Continues after frame `sequence` of another call. `tier` was chosen for it; "" if none was.
  void resume(uint64_t sequence, std::string tier);

  // Schedules a change. The later of two changes for the same frame counts. INVALID_ARGUMENT if that frame
  // came already or v1::kMaxPendingChanges are pending; otherwise fails as session_settings_from and as
  // claiming its table do.
  absl::Status add(const v1::SettingsChange& change);

  // Moves on to frame `sequence`. A change of settings discards the tier that was chosen before.
  void advance(uint64_t sequence);

  // Whether max_ms has to choose a tier for the newest frame.
  bool wants_tier() const { return now_.settings->has_max_ms() && !choice_; }
  void choose(TierChoice choice) { choice_ = std::move(choice); }

  // The settings as the client sent them.
  const SessionSettings& now() const { return now_; }
  // The settings to render with: those of now(), with the tier that max_ms chose. If there is
  // max_error_codes, too, it is the costliest one that each frame may have.
  Settings of_frame() const;
  // The tier that max_ms chose and the reason for it; "" if there is none.
  std::string tier() const { return choice_ ? choice_->tier : ""; }
  std::string tier_reason() const { return choice_ ? choice_->reason : ""; }

 private:
  SessionSettings now_;
  const v1::Encoding encoding_;
  const ClaimTable claim_table_;
  std::optional<TierChoice> choice_;
  std::optional<uint64_t> last_sequence_;
  std::map<uint64_t, SessionSettings> changes_;  // by the first frame that has them
};

}  // namespace candela
