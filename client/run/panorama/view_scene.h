// The views that `candela view` asks the server for, as messages.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/run/options.h"
#include "client/run/panorama/camera_path.h"

namespace candela {

inline constexpr uint64_t kMostViewFrames = 100000;  // of a sequence

class ViewScene {
 public:
  // Reads the files of objects and of camera keys that the options name. `options` must outlive this. Fails,
  // too, if the keys ask for more than kMostViewFrames.
  static absl::StatusOr<ViewScene> open(const PanoramaViewOptions& options);

  // The frames of a sequence: as many as the user says, 10 seconds of a turn, or those up to the last key.
  uint64_t frames() const { return frames_; }
  FrameRate rate() const { return options_->rate.value_or(FrameRate()); }

  // Frame `index`, counted from 0; a single view is frame 0. `environment` is the panorama's id.
  v1::View view(const std::string& environment, uint64_t index) const;

 private:
  ViewScene(const PanoramaViewOptions& options, std::vector<v1::Sphere> objects, CameraPath path)
      : options_(&options), objects_(std::move(objects)), path_(std::move(path)) {}

  const PanoramaViewOptions* options_;
  std::vector<v1::Sphere> objects_;
  CameraPath path_;  // without --path one key, the camera of the options
  uint64_t frames_ = 1;
};

}  // namespace candela
