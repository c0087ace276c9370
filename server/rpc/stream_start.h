// What opens a stream, checked.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/render/settings/settings.h"
#include "server/schedule/image_file.h"

namespace candela {

// A session's settings from some frame on, and what a resume token knows them by.
struct SessionSettings {
  Settings settings;
  std::string hash;
};

struct StreamStart {
  std::string session;
  SessionSettings settings;
  std::string resume_token;  // empty: none
  uint32_t lookahead = 0;
  double cut_threshold_ev = 0.0;  // 0: none are detected
  Encoding encoding = Encoding::kRaw;
  int jpeg_quality = 90;
};

// INVALID_ARGUMENT naming the field, its value and its range.
absl::StatusOr<StreamStart> stream_start_from(const v1::StreamOpen& open);

// As settings_from, and INVALID_ARGUMENT where the output format has no such encoding.
absl::StatusOr<SessionSettings> session_settings_from(const v1::Settings& message, Encoding encoding);

}  // namespace candela
