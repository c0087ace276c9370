#include "client/run/panorama/view_scene.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/base/usage.h"
#include "client/run/panorama/view_objects.h"
#include "client/run/sequence/frame_numbers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr double kTurnSeconds = 10;

double seconds(uint64_t frames, FrameRate rate) {
  return static_cast<double>(frames) * static_cast<double>(rate.seconds) / static_cast<double>(rate.frames);
}

// The frames that begin before or at this time; a time that is one but for rounding counts as it.
uint64_t frames_until(double time, FrameRate rate) {
  const double frame = time * static_cast<double>(rate.frames) / static_cast<double>(rate.seconds);
  return static_cast<uint64_t>(std::floor(frame + 1e-6)) + 1;
}

}  // namespace

absl::StatusOr<ViewScene> ViewScene::open(const PanoramaViewOptions& options) {
  ASSIGN_OR_RETURN(std::vector<v1::Sphere> objects, view_objects(options.objects));
  const v1::Camera& camera = options.camera;
  absl::StatusOr<CameraPath> path(CameraPath({{.time = 0,
                                               .yaw = camera.yaw_deg(),
                                               .pitch = camera.pitch_deg(),
                                               .roll = camera.roll_deg(),
                                               .fov = camera.fov_deg()}}));
  if (!options.camera_path.empty()) path = CameraPath::read(options.camera_path, camera);
  if (!path.ok()) return path.status();
  ViewScene scene(options, std::move(objects), *std::move(path));
  if (!options.is_sequence()) return scene;
  scene.frames_ = options.turn_deg ? frames_until(kTurnSeconds, scene.rate()) - 1
                                   : frames_until(scene.path_.end(), scene.rate());
  scene.frames_ = std::max<uint64_t>(1, options.frames.value_or(scene.frames_));
  if (scene.frames_ > kMostViewFrames) {
    const std::string words = absl::StrFormat("at %s fps it has %d frames, and the limit is %d; lower --fps",
                                              to_text(scene.rate()), scene.frames_, kMostViewFrames);
    if (options.turn_deg) return usage_error("--turn: " + words + ", or give --frames");
    return input_failure(
        absl::InvalidArgumentError(absl::StrFormat(
            "%s: %s or the keys' times, which are seconds, or give --frames", options.camera_path, words)),
        options.camera_path);
  }
  return scene;
}

v1::View ViewScene::view(const std::string& environment, uint64_t index) const {
  v1::View view;
  view.set_environment(environment);
  view.set_rotation_deg(options_->rotation_deg);
  view.set_samples(options_->samples);
  const CameraKey key = path_.at(seconds(index, rate()));
  const double turned = static_cast<double>(index) / static_cast<double>(frames_);
  v1::Camera& camera = *view.mutable_camera();
  camera.set_yaw_deg(key.yaw + options_->turn_deg.value_or(0) * turned);
  camera.set_pitch_deg(key.pitch);
  camera.set_roll_deg(key.roll);
  camera.set_fov_deg(key.fov);
  for (const v1::Sphere& object : objects_) *view.add_objects() = object;
  return view;
}

}  // namespace candela
