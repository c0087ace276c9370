#include "client/run/panorama/camera_path.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/run/panorama/json_fields.h"

namespace candela {
namespace {

constexpr v1::Range<double> kTime{0, 1e6};
constexpr size_t kMostKeys = 10000;

CameraKey key_from(const nlohmann::json& object, const std::string& name, const v1::Camera& camera,
                   absl::Status& status) {
  JsonFields fields(object, name, status);
  fields.allow({"time", "yaw", "pitch", "roll", "fov"});
  return {.time = fields.number("time", kTime, std::nullopt),
          .yaw = fields.number("yaw", v1::kCameraAngleDeg, camera.yaw_deg()),
          .pitch = fields.number("pitch", v1::kCameraAngleDeg, camera.pitch_deg()),
          .roll = fields.number("roll", v1::kCameraAngleDeg, camera.roll_deg()),
          .fov = fields.number("fov", v1::kFovDeg, camera.fov_deg())};
}

// The slope at the end of a chord of the slope `near` and the length `length`, with the chord `far` beyond.
double end_slope(double near, double length, double far, double far_length) {
  const double part = length / (length + far_length);
  const double slope = near * (1 + part) - far * part;
  if (slope * near <= 0) return 0;
  return std::abs(slope) > 2 * std::abs(near) ? 2 * near : slope;
}

// The slope between two chords.
double inner_slope(double before, double length, double after, double after_length) {
  if (before * after <= 0) return 0;
  const double mean = (before * after_length + after * length) / (length + after_length);
  return std::copysign(2 * std::min({std::abs(before), std::abs(after), 0.5 * std::abs(mean)}), before);
}

}  // namespace

absl::StatusOr<CameraPath> CameraPath::read(const std::string& path, const v1::Camera& camera) {
  const absl::StatusOr<nlohmann::json> json = read_json(path, "camera keys");
  if (!json.ok()) return json.status();
  absl::Status status;
  JsonFields file(*json, "", status);
  file.allow({"keys"});
  std::vector<CameraKey> keys;
  for (const nlohmann::json& object : file.array("keys", 1, kMostKeys)) {
    const std::string name = absl::StrFormat("keys[%d].", keys.size());
    keys.push_back(key_from(object, name, camera, status));
    if (keys.size() > 1 && keys.back().time <= keys[keys.size() - 2].time) {
      status.Update(absl::InvalidArgumentError(absl::StrFormat(
          "%stime is %s; it must be greater than keys[%d].time, %s", name, in_digits(keys.back().time, 6),
          keys.size() - 2, in_digits(keys[keys.size() - 2].time, 6))));
    }
  }
  if (status.ok()) return CameraPath(std::move(keys));
  return input_failure(reworded(status, absl::StrFormat("%s: %s", path, status.message())), path);
}

CameraPath::CameraPath(std::vector<CameraKey> keys) : keys_(std::move(keys)) {}

CameraKey CameraPath::at(double time) const {
  if (time <= keys_.front().time) return keys_.front();
  if (time >= keys_.back().time) return keys_.back();
  const auto after = std::upper_bound(keys_.begin(), keys_.end(), time,
                                      [](double t, const CameraKey& key) { return t < key.time; });
  const auto key = static_cast<size_t>(after - keys_.begin()) - 1;
  return {.time = time,
          .yaw = angle_at(&CameraKey::yaw, key, time),
          .pitch = angle_at(&CameraKey::pitch, key, time),
          .roll = angle_at(&CameraKey::roll, key, time),
          .fov = angle_at(&CameraKey::fov, key, time)};
}

// The cubic from `key` to the next one, in Hermite's form.
double CameraPath::angle_at(Angle angle, size_t key, double time) const {
  const CameraKey &a = keys_[key], &b = keys_[key + 1];
  const double length = b.time - a.time, t = (time - a.time) / length;
  const double rise = b.*angle - a.*angle;
  const double out = slope(angle, key) * length, in = slope(angle, key + 1) * length;
  const double value = a.*angle + t * (out + t * (3 * rise - 2 * out - in + t * (out + in - 2 * rise)));
  return std::clamp(value, std::min(a.*angle, b.*angle), std::max(a.*angle, b.*angle));
}

double CameraPath::slope(Angle angle, size_t key) const {
  const auto length = [this](size_t i) { return keys_[i + 1].time - keys_[i].time; };
  const auto chord = [&](size_t i) { return (keys_[i + 1].*angle - keys_[i].*angle) / length(i); };
  const size_t last = keys_.size() - 1;
  if (last == 1) return chord(0);
  if (key == 0) return end_slope(chord(0), length(0), chord(1), length(1));
  if (key == last) return end_slope(chord(last - 1), length(last - 1), chord(last - 2), length(last - 2));
  return inner_slope(chord(key - 1), length(key - 1), chord(key), length(key));
}

}  // namespace candela
