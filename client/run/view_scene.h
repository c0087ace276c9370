// What a view shows: objects, and a camera that stands or moves.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "client/run/options.h"

namespace candela {

// The spheres of `candela view --objects`.

// The word for the preset.
inline constexpr char kLookdev[] = "lookdev";

// The preset `lookdev` of docs/environments.md section 6, or the spheres of a file of the form
// {"objects": [{"centre": [x, y, z], "radius": r, "base_color": [r, g, b], "metallic": m, "roughness": r,
// "fixed_to_camera": true}]}; only centre and radius must be there. "" is no sphere. Errors begin with the
// path: those of read_json(), and INVALID_ARGUMENT that names the member that is wrong.
absl::StatusOr<std::vector<v1::Sphere>> view_objects(const std::string& choice);

// The moving camera of `candela view`.

struct CameraKey {
  double time = 0;                                // seconds
  double yaw = 0, pitch = 0, roll = 0, fov = 60;  // degrees
};

// Keys with a smooth camera between them: each angle is a monotone cubic of time (Steffen's), which has no
// corner at a key and never goes beyond the two keys beside it. So a field of view stays within its range,
// and between two equal keys the camera rests. Before the first key and after the last one it rests, too.
// Angles are not wrapped: from yaw 0 to yaw 720 the camera turns twice.
class CameraPath {
 public:
  // Reads {"keys": [{"time": 0, "yaw": 0, "pitch": 0, "roll": 0, "fov": 60}, ...]}, with ascending times. An
  // angle that a key leaves out is that of `camera`. Errors begin with the path: those of read_json(), and
  // INVALID_ARGUMENT that names the member that is wrong.
  static absl::StatusOr<CameraPath> read(const std::string& path, const v1::Camera& camera);

  // At least one key, with ascending times.
  explicit CameraPath(std::vector<CameraKey> keys);

  CameraKey at(double time) const;
  double end() const { return keys_.back().time; }

 private:
  using Angle = double CameraKey::*;
  double angle_at(Angle angle, size_t key, double time) const;
  double slope(Angle angle, size_t key) const;

  std::vector<CameraKey> keys_;
};

// The views that `candela view` asks the server for, as messages.

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
