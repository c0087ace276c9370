// A session's settings from frame to frame.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "server/render/settings/tier_choice.h"
#include "server/rpc/stream_start.h"
#include "server/schedule/image_file.h"

namespace candela {

// Those that the frame which came last has, the tier that was chosen where they promise one, and what frames
// to come change them to. One thread at a time.
class SettingsTrack {
 public:
  // Before the first frame.
  SettingsTrack(SessionSettings opened, Encoding encoding);

  // Goes on behind the frame `sequence` of another call, for which `tier` had been chosen; "" for none.
  void resume(uint64_t sequence, std::string tier);

  // INVALID_ARGUMENT where the frame came already, for one change more than v1::kMaxPendingChanges, and as
  // session_settings_from. The last of two changes from the same frame on counts.
  absl::Status add(const v1::SettingsChange& change);

  // The frame `sequence` comes. A change drops the tier that was chosen before it.
  void advance(uint64_t sequence);

  // Whether a tier has to be chosen before the frame can be rendered.
  bool wants_tier() const { return now_.settings.promise.given() && !choice_; }
  void choose(TierChoice choice) { choice_ = std::move(choice); }

  // As they were asked for.
  const SessionSettings& now() const { return now_; }
  // To render with: of the tier that was chosen.
  Settings of_frame() const;
  // "" for none.
  std::string tier() const { return choice_ ? choice_->tier : ""; }
  std::string tier_reason() const { return choice_ ? choice_->reason : ""; }

 private:
  SessionSettings now_;
  const Encoding encoding_;
  std::optional<TierChoice> choice_;
  std::optional<uint64_t> last_sequence_;
  std::map<uint64_t, SessionSettings> changes_;  // by the first frame they are for
};

}  // namespace candela
