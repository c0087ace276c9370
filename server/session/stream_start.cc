#include "server/session/stream_start.h"

#include <algorithm>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
#include "server/session/render_start.h"
#include "server/session/resume_token.h"

namespace candela {
namespace {

absl::Status check_name(const std::string& session) {
  const bool plain = std::all_of(session.begin(), session.end(), [](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_';
  });
  if (!session.empty() && session.size() <= v1::kMaxSessionNameBytes && plain) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrFormat(
      "open.session has %d bytes; a session's name has 1 to %d letters, digits, dots, dashes and underscores",
      session.size(), v1::kMaxSessionNameBytes));
}

absl::Status check_encoding(v1::Encoding encoding, const v1::Settings& settings) {
  const v1::OutputFormat format = settings.output_format();
  if (encoding == v1::ENCODING_PNG && format == v1::OUTPUT_FORMAT_RGBA16F) {
    return absl::InvalidArgumentError(
        "output_format is RGBA16F and encoding is PNG; a PNG holds RGBA8 or RGBA16, so use one of them or "
        "the encoding RAW");
  }
  if (encoding == v1::ENCODING_PNG && settings.has_gain_map_peak_nits()) {
    return absl::InvalidArgumentError(
        "there is gain_map_peak_nits and encoding is PNG, which has no gain map; use JPEG or RAW");
  }
  if (encoding == v1::ENCODING_JPEG && format != v1::OUTPUT_FORMAT_RGBA8) {
    return absl::InvalidArgumentError(
        absl::StrFormat("output_format is %s and encoding is JPEG; a JPEG holds "
                        "RGBA8, so use that format or the encoding PNG or RAW",
                        v1::word_of(format)));
  }
  if (encoding == v1::ENCODING_JPEG && settings.alpha() == v1::ALPHA_STRAIGHT) {
    return absl::InvalidArgumentError(
        "alpha is STRAIGHT and encoding is JPEG, which has no alpha; "
        "use ASSOCIATED, which is the colour over black, or OVER");
  }
  return absl::OkStatus();
}

absl::Status take_state(const v1::StreamOpen& open, StreamStart& start) {
  start.return_state = open.return_state();
  if (!open.has_state()) return absl::OkStatus();
  if (!open.resume_token().empty()) {
    return absl::InvalidArgumentError(
        "open.state and open.resume_token are both set; a new session begins with the first and a session "
        "resumes with the second");
  }
  ASSIGN_OR_RETURN(start.state, point_from(open.state()));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<SessionSettings> session_settings_from(const v1::Settings& message, v1::Encoding encoding) {
  ASSIGN_OR_RETURN(Settings settings, Settings::from(message));
  RETURN_IF_ERROR(check_encoding(encoding, *settings));
  return SessionSettings{std::move(settings), settings_hash(message)};
}

absl::StatusOr<StreamStart> stream_start_from(const v1::StreamOpen& open) {
  StreamStart start;
  RETURN_IF_ERROR(check_name(open.session()));
  start.session = open.session();
  if (open.lookahead() > v1::kLookahead.max) {
    return absl::InvalidArgumentError(
        absl::StrFormat("open.lookahead is %d; it must be between %d and %d frames", open.lookahead(),
                        v1::kLookahead.min, v1::kLookahead.max));
  }
  start.lookahead = open.lookahead();
  // Written so that NaN fails.
  if (!(open.cut_threshold_ev() >= v1::kCutThresholdEv.min &&
        open.cut_threshold_ev() <= v1::kCutThresholdEv.max)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("open.cut_threshold_ev is %g; it must be between %g and %g EV",
                        open.cut_threshold_ev(), v1::kCutThresholdEv.min, v1::kCutThresholdEv.max));
  }
  start.cut_threshold_ev = open.cut_threshold_ev();
  if (!v1::Encoding_IsValid(open.encoding())) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "open.encoding is %d, which this server does not know; it knows RAW (1), PNG (2), JPEG (3) and "
        "NONE (4)",
        static_cast<int>(open.encoding())));
  }
  if (open.encoding() != v1::ENCODING_UNSPECIFIED) start.encoding = open.encoding();
  const uint32_t quality = open.jpeg_quality() == 0 ? v1::kDefaultJpegQuality : open.jpeg_quality();
  if (quality > v1::kJpegQuality.max) {
    return absl::InvalidArgumentError(absl::StrFormat("open.jpeg_quality is %d; it must be between %d and %d",
                                                      quality, v1::kJpegQuality.min, v1::kJpegQuality.max));
  }
  start.jpeg_quality = static_cast<int>(quality);
  if (open.resume_token().size() > v1::kMaxTokenBytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("open.resume_token has %d bytes and a token has at most %d; send it unchanged",
                        open.resume_token().size(), v1::kMaxTokenBytes));
  }
  start.resume_token = open.resume_token();
  RETURN_IF_ERROR(take_state(open, start));
  ASSIGN_OR_RETURN(start.settings, session_settings_from(open.settings(), start.encoding));
  return start;
}

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
