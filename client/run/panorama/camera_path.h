// The moving camera of `candela view`.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"

namespace candela {

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

}  // namespace candela
