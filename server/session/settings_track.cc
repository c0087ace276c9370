#include "server/session/settings_track.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"

namespace candela {

SettingsTrack::SettingsTrack(SessionSettings opened, v1::Encoding encoding, ClaimTable claim_table)
    : now_(std::move(opened)), encoding_(encoding), claim_table_(std::move(claim_table)) {}

absl::Status SettingsTrack::add(const v1::SettingsChange& change) {
  if (last_sequence_ && change.from_sequence() <= *last_sequence_) {
    return absl::InvalidArgumentError(
        absl::StrFormat("change.from_sequence is %d and frame %d came already; name a later frame",
                        change.from_sequence(), *last_sequence_));
  }
  if (changes_.size() >= v1::kMaxPendingChanges && changes_.count(change.from_sequence()) == 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d changes of settings are pending, which is the limit; send their frames first", changes_.size()));
  }
  std::shared_ptr<const void> claim;
  if (change.settings().has_table()) {
    ASSIGN_OR_RETURN(claim, claim_table_(change.settings().table().values().size()));
  }
  ASSIGN_OR_RETURN(SessionSettings settings, session_settings_from(change.settings(), encoding_));
  if (settings.settings.table() != nullptr) {
    settings.settings = settings.settings.with_table_owner(std::move(claim));
  }
  changes_.insert_or_assign(change.from_sequence(), std::move(settings));
  return absl::OkStatus();
}

void SettingsTrack::advance(uint64_t sequence) {
  last_sequence_ = sequence;
  while (!changes_.empty() && changes_.begin()->first <= sequence) {
    now_ = std::move(changes_.begin()->second);
    changes_.erase(changes_.begin());
  }
}

}  // namespace candela
