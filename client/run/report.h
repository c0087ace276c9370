// What a run has done, as values. A command says it as text and as JSON.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "candela/v1/render.pb.h"
#include "client/base/failure.h"
#include "client/color/view_error.h"
#include "client/run/baked_view.h"
#include "client/run/exposure_file.h"
#include "client/run/frame_source.h"
#include "client/run/hdr_gain_map.h"
#include "client/run/options.h"
#include "client/run/picture_error.h"
#include "client/run/picture_frame.h"
#include "client/run/sequence.h"
#include "client/session.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// The time since `begin`, for stage_ms and total_ms.
inline double ms_since(absl::Time begin) { return absl::ToDoubleMilliseconds(absl::Now() - begin); }

inline double ms_of(const v1::StageTime& stage) { return static_cast<double>(stage.ns()) * 1e-6; }

// Names and milliseconds.
using StageMs = std::vector<std::pair<std::string, double>>;

// Adds the stages of a result's header, and as "other" the rest of a call that took `call_ms`.
template <typename Header>
void add_server_stages(const Header& header, double call_ms, StageMs& stages) {
  double server_ms = 0;
  for (const v1::StageTime& stage : header.stages()) {
    stages.emplace_back(stage.name(), ms_of(stage));
    server_ms += ms_of(stage);
  }
  stages.emplace_back("other", std::max(0.0, call_ms - server_ms));
}

struct RenderReport {
  std::string input;
  std::string output;
  std::string environment;  // the id of the panorama that it is a view of; "": it is a frame
  PrimariesUsed primaries;
  uint64_t missing_pixels = 0;  // of an unfinished or damaged file
  v1::ImageSize frame;          // of the frame, or of the view as it is drawn
  std::string curve;            // its word, or the name of the view of --ocio
  v1::ResultHeader header;
  std::string error_map;  // "" if none is written
  bool metered = true;    // false if the user set the exposure
  PictureDefaults defaults;
  std::optional<ViewReport> view;
  std::optional<ViewError> view_error;                    // only with --verify
  std::optional<FileError> file_error;                    // only with `errors`, of a file that loses detail
  std::shared_ptr<const GainMapCodes> gain_map;           // of three channels, or null
  std::optional<GainMapError> gain_map_error;             // the same of a gain map
  std::optional<ErrorParts> errors;                       // only with --verify or --max-error
  v1::ToneCurve tone_curve = v1::TONE_CURVE_UNSPECIFIED;  // as the settings have it
  // In this order: start, view, read, the server's stages, other, hdr, write; of a view of a panorama: ocio,
  // read, start, put, the server's stages, other, write. The built-in server starts while the image is read.
  // `hdr` is the second rendering for a gain map, and the map.
  // `other` is the part of the call outside the server's stages: sending, receiving, and compiling shaders
  // for a first frame.
  StageMs stage_ms;
  double total_ms = 0;  // from the start of the command until the file is written
  std::vector<std::string> notes;
};

// The outcome of one frame of a run.
struct RunFrame {
  FrameFacts facts;  // of a held frame: those of the file whose image it repeats, but number, time and place
  std::string output;       // "" if no image is written
  bool held = false;        // has the image of the one before
  bool missing = false;     // has no file
  absl::Status status;      // why there is no image of its own: reading or rendering failed
  v1::ResultHeader header;  // only if the frame was rendered
  absl::Duration latency;
};

struct RunSummary {
  uint64_t frames = 0;  // files, or those of a pipe
  int64_t first = 0;    // the number of the first one
  int64_t last = 0;     // and of the last one
  std::string missing;  // numbers without a file, as --range takes them
  ChosenRate rate;
  uint64_t written = 0;  // without held ones
  uint64_t held = 0;
  uint64_t skipped = 0;                    // unreadable, or refused by the server
  std::optional<FailureKind> skipped_for;  // their common kind; nothing: none was skipped
  absl::Duration time;                     // from the first frame to the last image
  absl::Duration latency;                  // the sum over all frames
  std::vector<ExposedFrame> curve;
  double locked = 1;       // the locked exposure of the curve
  std::string saved;       // the exposure file that is written; "": none
  v1::SessionState state;  // after the last frame, if it is saved
  SessionStats session;
  PictureDefaults defaults;
  std::string view;                 // view_words() of --ocio, "" without it
  std::set<std::string> notes;      // notes about the files
  std::set<std::string> primaries;  // words_of() of those that frames had
  bool reader_left = false;         // of standard output, so that the rest of the frames has no image

  // Counts a frame that is where it belongs, or that has no image.
  void count(const RunFrame& frame) {
    if (frame.held) {
      ++held;
    } else if (frame.status.ok()) {
      ++written;
      latency += frame.latency;
    }
    if (frame.status.ok() || frame.missing) return;
    ++skipped;
    add_failure(skipped_for, frame.status);
  }
};

}  // namespace candela
