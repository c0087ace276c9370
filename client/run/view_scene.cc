#include "client/run/view_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "client/base/plain_file.h"
#include "client/run/frame_numbers.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
#include "server/base/words.h"

namespace candela {
namespace {

// Reads the small JSON files that users write: objects of a scene, keys of a camera.

// The members of one object. The first failure goes into `status`; later ones are left out.
class JsonFields {
 public:
  // `name` stands before the members' names in errors, as "keys[2]."; `object` and `status` must outlive it.
  JsonFields(const nlohmann::json& object, std::string name, absl::Status& status)
      : object_(object), name_(std::move(name)), status_(status) {}

  // Refuses anything but an object with some of these members, so that a typing error does not go unnoticed.
  void allow(std::initializer_list<const char*> members);

  // Without a value for `absent` the member must be there.
  double number(const char* key, v1::Range<double> range, std::optional<double> absent);
  std::array<double, 3> triple(const char* key, v1::Range<double> range,
                               std::optional<std::array<double, 3>> absent);
  bool flag(const char* key, bool absent);
  // An array with at least `least` elements, which must be there.
  const nlohmann::json& array(const char* key, size_t least, size_t most);

  void fail(const std::string& key, const std::string& wanted);

 private:
  const nlohmann::json* member(const char* key) const;

  const nlohmann::json& object_;
  const std::string name_;
  absl::Status& status_;
};

constexpr size_t kMaxJsonBytes = size_t{1} << 20;

bool is_within(const nlohmann::json& value, v1::Range<double> range) {
  return value.is_number() && value.get<double>() >= range.min && value.get<double>() <= range.max;
}

// The object in the file `path`. `what` is what the file should hold, as "camera keys". Errors begin with the
// path: NOT_FOUND if it cannot be read, INVALID_ARGUMENT if it is no JSON object or is larger than 1 MiB.
absl::StatusOr<nlohmann::json> read_json(const std::string& path, const std::string& what) {
  const absl::StatusOr<std::string> text = read_plain_file(path, kMaxJsonBytes);
  if (!text.ok()) {
    return input_failure(
        reworded(text.status(),
                 absl::StrFormat("%s: cannot read this file of %s: %s; `candela view --help` shows one", path,
                                 what, text.status().message())),
        path);
  }
  nlohmann::json json = nlohmann::json::parse(*text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) {
    return input_failure(
        absl::InvalidArgumentError(absl::StrFormat(
            "%s: it holds no JSON object; `candela view --help` shows a file of %s", path, what)),
        path);
  }
  return json;
}

void JsonFields::allow(std::initializer_list<const char*> members) {
  if (!object_.is_object()) {
    status_.Update(absl::InvalidArgumentError(
        absl::StrFormat("%s must be a JSON object", name_.substr(0, name_.size() - 1))));
    return;
  }
  const std::vector<std::string> known(members.begin(), members.end());
  for (const auto& [key, value] : object_.items()) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string meant = did_you_mean(near_words(key, known));
    status_.Update(absl::InvalidArgumentError(
        absl::StrFormat("unknown key %s%s; %s", name_, key,
                        meant.empty() ? "there are: " + absl::StrJoin(known, ", ") : meant)));
  }
}

double JsonFields::number(const char* key, v1::Range<double> range, std::optional<double> absent) {
  const nlohmann::json* value = member(key);
  if (value == nullptr && absent) return *absent;
  if (value != nullptr && is_within(*value, range)) return value->get<double>();
  fail(key, "a number, " + v1::format_range(range.min, range.max));
  return range.min;
}

std::array<double, 3> JsonFields::triple(const char* key, v1::Range<double> range,
                                         std::optional<std::array<double, 3>> absent) {
  const nlohmann::json* value = member(key);
  if (value == nullptr && absent) return *absent;
  std::array<double, 3> numbers{};
  bool good = value != nullptr && value->is_array() && value->size() == numbers.size();
  for (size_t i = 0; good && i < numbers.size(); ++i) {
    good = is_within((*value)[i], range);
    if (good) numbers[i] = (*value)[i].get<double>();
  }
  if (!good) fail(key, "an array of three numbers, " + v1::format_range(range.min, range.max));
  return numbers;
}

bool JsonFields::flag(const char* key, bool absent) {
  const nlohmann::json* value = member(key);
  if (value == nullptr) return absent;
  if (!value->is_boolean()) fail(key, "true or false");
  return value->is_boolean() && value->get<bool>();
}

const nlohmann::json& JsonFields::array(const char* key, size_t least, size_t most) {
  static const nlohmann::json kEmpty = nlohmann::json::array();
  const nlohmann::json* value = member(key);
  if (value != nullptr && value->is_array() && value->size() >= least && value->size() <= most) return *value;
  fail(key, absl::StrFormat("an array of %d to %d objects", least, most));
  return kEmpty;
}

void JsonFields::fail(const std::string& key, const std::string& wanted) {
  constexpr size_t kShown = 40;
  const nlohmann::json* found = member(key.c_str());
  std::string value =
      found == nullptr ? "missing" : found->dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  if (value.size() > kShown) value = value.substr(0, kShown) + "...";
  status_.Update(
      absl::InvalidArgumentError(absl::StrFormat("%s%s is %s; it must be %s", name_, key, value, wanted)));
}

const nlohmann::json* JsonFields::member(const char* key) const {
  return object_.is_object() && object_.contains(key) ? &object_.at(key) : nullptr;
}

using Triple = std::array<double, 3>;

constexpr v1::Range<double> kCoordinate{-v1::kMaxCoordinate, v1::kMaxCoordinate};
constexpr v1::Range<double> kRadius{v1::kLeastRadius, v1::kMaxCoordinate};
constexpr v1::Range<double> kUnit{0, 1};
constexpr Triple kGrey{0.8, 0.8, 0.8};

void set_vector(v1::Vector& vector, const Triple& xyz) {
  vector.set_x(xyz[0]);
  vector.set_y(xyz[1]);
  vector.set_z(xyz[2]);
}

struct LookdevSphere {
  double x;
  Triple base_color;
  double metallic, roughness;
};
constexpr LookdevSphere kLookdevSpheres[] = {
    {-1.8, {1, 1, 1}, 1, 0},           // chrome
    {-0.6, {0.18, 0.18, 0.18}, 0, 1},  // grey
    {0.6, {1, 0.766, 0.336}, 1, 0.3},  // gold
    {1.8, {0.8, 0.8, 0.8}, 0, 0.5},    // plastic
};

std::vector<v1::Sphere> lookdev() {
  std::vector<v1::Sphere> spheres;
  for (const LookdevSphere& look : kLookdevSpheres) {
    v1::Sphere& sphere = spheres.emplace_back();
    set_vector(*sphere.mutable_centre(), {look.x, 0, -4});
    sphere.set_radius(0.5);
    set_vector(*sphere.mutable_base_color(), look.base_color);
    sphere.set_metallic(look.metallic);
    sphere.set_roughness(look.roughness);
    sphere.set_fixed_to_camera(true);
  }
  return spheres;
}

v1::Sphere sphere_from(const nlohmann::json& object, const std::string& name, absl::Status& status) {
  JsonFields fields(object, name, status);
  fields.allow({"centre", "radius", "base_color", "metallic", "roughness", "fixed_to_camera"});
  v1::Sphere sphere;
  set_vector(*sphere.mutable_centre(), fields.triple("centre", kCoordinate, std::nullopt));
  sphere.set_radius(fields.number("radius", kRadius, std::nullopt));
  set_vector(*sphere.mutable_base_color(), fields.triple("base_color", kUnit, kGrey));
  sphere.set_metallic(fields.number("metallic", kUnit, 0));
  sphere.set_roughness(fields.number("roughness", kUnit, 0.5));
  sphere.set_fixed_to_camera(fields.flag("fixed_to_camera", false));
  return sphere;
}

}  // namespace

absl::StatusOr<std::vector<v1::Sphere>> view_objects(const std::string& choice) {
  if (choice.empty()) return std::vector<v1::Sphere>();
  if (choice == kLookdev) return lookdev();
  const absl::StatusOr<nlohmann::json> json = read_json(choice, "objects");
  if (!json.ok()) return json.status();
  absl::Status status;
  JsonFields file(*json, "", status);
  file.allow({"objects"});
  std::vector<v1::Sphere> spheres;
  for (const nlohmann::json& object : file.array("objects", 0, v1::kMaxObjects)) {
    spheres.push_back(sphere_from(object, absl::StrFormat("objects[%d].", spheres.size()), status));
  }
  if (status.ok()) return spheres;
  return input_failure(reworded(status, absl::StrFormat("%s: %s", choice, status.message())), choice);
}

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
