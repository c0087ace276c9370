// The open message of a stream, checked.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

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

}  // namespace candela
