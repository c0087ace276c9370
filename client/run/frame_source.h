// What gives a run its frames: files, or cameras in a panorama.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "client/image/image.h"
#include "client/run/picture_frame.h"
#include "client/session.h"
#include "proto/candela/v1/image_size.h"

namespace candela {

// Facts about a frame that its image and its report need.
struct FrameFacts {
  int64_t number = 0;
  std::string input;   // its file
  uint64_t place = 0;  // of its image among all images of the run
  int64_t media_time_ns = 0;
  bool cut = false;             // begins a scene
  bool exposure_given = false;  // metering does not decide it
  bool has_alpha = false;
  v1::ImageSize size = {};                   // of the frame
  double pixel_aspect = 1;                   // of its image
  std::optional<FrameRate> frame_rate = {};  // if the user gave it or a file says it
  PrimariesUsed primaries = {};
  PictureDefaults defaults = {};                            // of the settings that it is shown with
  std::optional<std::array<float, 8>> kept_primaries = {};  // as in PictureSettings
  std::shared_ptr<const KeptAttributes> kept = {};          // as in Image
  uint64_t missing_pixels = 0;                              // of an unfinished or damaged file
};

struct SourceFrame {
  SessionFrame frame;     // if there is none, only its sequence number is set
  absl::Status status;    // why there is none
  v1::Settings settings;  // only what take_input_of() takes counts
  FrameFacts facts;
  std::vector<std::string> notes;
};

// Used by one thread at a time.
class FrameSource {
 public:
  virtual ~FrameSource() = default;

  // The number of frames; 0 if it is not known.
  virtual uint64_t frames() const = 0;

  // The next frame, in the order of their sequence numbers; nothing after the last.
  virtual std::optional<SourceFrame> next() = 0;

  // next() returns nothing more, also if it waits. Any thread.
  virtual void stop() {}
};

}  // namespace candela
