#include "client/run/exposure_file.h"

#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/base/plain_file.h"
#include "client/image/write/atomic_file.h"
#include "client/run/frame_numbers.h"
#include "client/run/output_files.h"
#include "proto/candela/v1/limits.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
#include "server/render/color/portable_math.h"

namespace candela {
namespace {

using Json = nlohmann::ordered_json;

constexpr char kFormat[] = "candela-exposures";
constexpr int kVersion = 1;
constexpr size_t kMaxBytes = size_t{256} << 20;
constexpr int kMaxDepth = 8;
constexpr size_t kPictureCells = 64;

v1::Exposure completed(const v1::Exposure& exposure) {
  v1::Settings settings;
  *settings.mutable_exposure() = exposure;
  // Settings out of range would fail here, and the server has refused those.
  (void)v1::complete_settings(settings);
  return settings.exposure();
}

Json settings_json(const ExposureFile& file) {
  std::string text;
  (void)google::protobuf::util::MessageToJsonString(completed(file.settings), &text);
  return {{"exposure", Json::parse(text, nullptr, false)},
          {"lookahead", file.lookahead},
          {"cut_threshold_ev", file.cut_threshold_ev}};
}

Json state_json(const ExposureFile& file) {
  const v1::SessionState& state = file.state;
  Json json = {{"frame", file.last()},
               {"media_time_ns", state.media_time_ns()},
               {"exposure", state.exposure()},
               {"target", state.target()},
               {"cut_pending", state.cut_pending()}};
  // JSON has no NaN, which is a cell with nothing metered.
  Json& picture = json["picture"] = Json::array();
  for (const float cell : state.picture()) {
    picture.push_back(std::isnan(cell) ? Json() : Json(static_cast<double>(cell)));
  }
  return json;
}

// Reads members of an object, and keeps the first failure.
class Members {
 public:
  // `name` names the object in messages, "frames[3]." for example.
  Members(const Json& object, std::string name, absl::Status& status)
      : object_(object), name_(std::move(name)), status_(status) {
    if (!object.is_object()) {
      status_.Update(
          absl::InvalidArgumentError(name_.substr(0, name_.size() - 1) + " must be a JSON object"));
    }
  }

  double number(const char* key, v1::Range<double> range) {
    const Json& value = member(key);
    const double number = value.is_number() ? value.get<double>() : range.min;
    // Written so that NaN fails.
    if (!value.is_number() || !(number >= range.min && number <= range.max)) {
      fail(key, absl::StrFormat("a number between %s and %s", v1::format_number(range.min),
                                v1::format_number(range.max)));
    }
    return number;
  }
  double factor(const char* key) { return number(key, v1::kExposureLimit); }
  int64_t frame(const char* key) {
    const Json& value = member(key);
    // A number above 2^63 would be negative as int64_t.
    const bool fits = !value.is_number_unsigned() || value.get<uint64_t>() <= uint64_t{kLargestFrameNumber};
    const int64_t number = value.is_number_integer() && fits ? value.get<int64_t>() : INT64_MIN;
    if (number >= -kLargestFrameNumber && number <= kLargestFrameNumber) return number;
    fail(key, absl::StrFormat("a frame's number, -%d .. %d", kLargestFrameNumber, kLargestFrameNumber));
    return 0;
  }
  int64_t time(const char* key) {
    const Json& value = member(key);
    if (value.is_number_unsigned() && value.get<uint64_t>() <= uint64_t{v1::kMediaTimeNs.max}) {
      return value.get<int64_t>();
    }
    fail(key, absl::StrFormat("a whole number of nanoseconds up to %d", v1::kMediaTimeNs.max));
    return 0;
  }
  FrameRate rate(const char* key) {
    const Json& value = member(key);
    const absl::StatusOr<FrameRate> rate =
        parse_frame_rate(key, value.is_string() ? value.get<std::string>() : "");
    if (!rate.ok()) fail(key, "a frame rate, such as \"24\" or \"24000/1001\"");
    return rate.value_or(FrameRate());
  }
  bool flag(const char* key) {
    const Json& value = member(key);
    if (!value.is_boolean()) fail(key, "true or false");
    return value.is_boolean() && value.get<bool>();
  }
  const Json& array(const char* key) {
    static const Json kEmpty = Json::array();
    const Json& value = member(key);
    if (value.is_array()) return value;
    fail(key, "an array");
    return kEmpty;
  }
  const Json& member(const char* key) const {
    static const Json kNone;
    return object_.is_object() && object_.contains(key) ? object_.at(key) : kNone;
  }
  void fail(const std::string& key, const std::string& wanted) {
    status_.Update(absl::InvalidArgumentError(absl::StrFormat("%s%s is not %s", name_, key, wanted)));
  }

 private:
  const Json& object_;
  const std::string name_;
  absl::Status& status_;
};

// Finds a key that one object holds twice. A parser would take the last one without a word.
class OnceKeys {
 public:
  void look(int depth, Json::parse_event_t event, const Json& value) {
    if (event == Json::parse_event_t::object_start) keys_[depth + 1].clear();
    if (event != Json::parse_event_t::key) return;
    const bool fresh = keys_[depth].insert(value.get<std::string>()).second;
    if (!fresh && twice_.empty()) twice_ = value.get<std::string>();
  }
  const std::string& twice() const { return twice_; }

 private:
  std::map<int, std::set<std::string>> keys_;  // by the depth of their object
  std::string twice_;
};

constexpr v1::Range<double> kAnyEv{-1e6, 1e6};

std::vector<ExposedFrame> frames_from(const Json& array, absl::Status& status) {
  std::vector<ExposedFrame> frames;
  frames.reserve(array.size());
  for (size_t i = 0; i < array.size() && status.ok(); ++i) {
    Members frame(array[i], absl::StrFormat("frames[%d].", i), status);
    frames.push_back({.frame = frame.frame("frame"),
                      .media_time_ns = frame.time("media_time_ns"),
                      .exposure = frame.factor("exposure"),
                      .target = frame.factor("target"),
                      .mean_log2_luminance = frame.number("mean_log2_luminance", kAnyEv),
                      .cut = frame.flag("cut")});
    if (i > 0 && frames[i].frame <= frames[i - 1].frame) frame.fail("frame", "above the one before");
  }
  return frames;
}

v1::SessionState state_from(const Json& object, int64_t zero, absl::Status& status) {
  Members members(object, "state.", status);
  v1::SessionState state;
  const int64_t frame = members.frame("frame");
  if (frame < zero) members.fail("frame", "a number from \"zero\" on");
  state.set_sequence(static_cast<uint64_t>(std::max<int64_t>(0, frame - zero)));
  state.set_media_time_ns(members.time("media_time_ns"));
  state.set_exposure(members.factor("exposure"));
  state.set_target(members.factor("target"));
  state.set_cut_pending(members.flag("cut_pending"));
  const Json& picture = members.array("picture");
  if (!picture.empty() && picture.size() != kPictureCells) {
    members.fail("picture", absl::StrFormat("an array of %d cells, or an empty one", kPictureCells));
  }
  for (const Json& cell : picture) {
    const double ev = cell.is_number() ? cell.get<double>() : 0;
    if (!cell.is_null() && (!cell.is_number() || !(ev >= v1::kPictureEv.min && ev <= v1::kPictureEv.max))) {
      members.fail("picture", absl::StrFormat("made of numbers between %s and %s, and null",
                                              v1::format_number(v1::kPictureEv.min),
                                              v1::format_number(v1::kPictureEv.max)));
    }
    state.add_picture(cell.is_null() ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(ev));
  }
  return state;
}

}  // namespace

double locked_exposure(const v1::Exposure& settings, const std::vector<ExposedFrame>& frames) {
  const v1::Exposure exposure = completed(settings);
  if (exposure.mode() == v1::Exposure::MODE_MANUAL) return portable_exp2(exposure.manual_ev());
  double sum = 0;
  double count = 0;
  for (const ExposedFrame& frame : frames) {
    if (frame.mean_log2_luminance == v1::kNothingMetered) continue;
    sum += frame.mean_log2_luminance;
    ++count;
  }
  const double mean = count > 0 ? sum / count : v1::kNothingMetered;
  return std::clamp(exposure.key() * portable_exp2(exposure.compensation_ev() - mean),
                    exposure.min_exposure(), exposure.max_exposure());
}

// One frame a line, so that people and line-based tools can read it.
std::string to_text(const ExposureFile& file) {
  std::string text = absl::StrFormat("{\"format\": \"%s\", \"version\": %d,\n", kFormat, kVersion);
  absl::StrAppendFormat(&text, " \"frame_rate\": \"%s\", \"zero\": %d,\n", to_text(file.rate), file.zero);
  absl::StrAppendFormat(&text, " \"settings\": %s,\n", settings_json(file).dump());
  absl::StrAppendFormat(&text, " \"locked\": %s,\n \"frames\": [", Json(file.locked).dump());
  const char* before = "\n";
  for (const ExposedFrame& frame : file.frames) {
    const Json json = {{"frame", frame.frame},
                       {"media_time_ns", frame.media_time_ns},
                       {"exposure", frame.exposure},
                       {"target", frame.target},
                       {"mean_log2_luminance", frame.mean_log2_luminance},
                       {"cut", frame.cut}};
    text += before + ("  " + json.dump());
    before = ",\n";
  }
  text += "\n ],\n \"state\": " + state_json(file).dump() + "}\n";
  return text;
}

absl::StatusOr<ExposureFile> parse_exposures(const std::string& text) {
  OnceKeys once;
  // Deeper values are nothing of ours, so they are not built.
  const auto shallow = [&once](int depth, Json::parse_event_t event, Json& value) {
    if (depth <= kMaxDepth) once.look(depth, event, value);
    return depth <= kMaxDepth;
  };
  const Json json = Json::parse(text, shallow, /*allow_exceptions=*/false);
  if (!once.twice().empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "\"%s\" is there twice in one object; the exposure file is damaged, so write it again",
        once.twice()));
  }
  if (!json.is_object() || json.value("format", Json()) != kFormat) {
    return absl::InvalidArgumentError(
        "this is not an exposure file, or it is damaged; `candela meter --save-exposures` writes one");
  }
  const Json version = json.value("version", Json());
  if (version != kVersion) {
    return absl::InvalidArgumentError(
        absl::StrFormat("the exposure file has version %s and this candela reads version %d; write it again "
                        "with this candela, or update candela",
                        version.dump(), kVersion));
  }
  absl::Status status;
  Members members(json, "", status);
  ExposureFile file;
  file.rate = members.rate("frame_rate");
  file.zero = members.frame("zero");
  if (const Json& settings = members.member("settings"); settings.is_object()) {
    const Json lookahead = settings.value("lookahead", Json());
    if (lookahead.is_number_unsigned()) file.lookahead = lookahead.get<uint32_t>();
  }
  file.locked = members.factor("locked");
  file.frames = frames_from(members.array("frames"), status);
  file.state = state_from(members.member("state"), file.zero, status);
  if (file.frames.empty()) {
    members.fail("frames", "an array of frames");
  } else if (file.frames.front().frame < file.zero) {
    members.fail("zero", "a number up to that of the first frame");
  }
  if (!status.ok()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s; the exposure file is damaged, so write it again", status.message()));
  }
  return file;
}

absl::StatusOr<ExposureFile> read_exposures(const std::string& path) {
  const absl::StatusOr<std::string> text = read_plain_file(path, kMaxBytes);
  if (!text.ok()) {
    return input_failure(
        reworded(text.status(), absl::StrFormat("%s: cannot read this exposure file: %s; `candela meter "
                                                "--save-exposures` writes one",
                                                path, text.status().message())),
        path);
  }
  absl::StatusOr<ExposureFile> file = parse_exposures(*text);
  if (file.ok()) return file;
  return input_failure(reworded(file.status(), absl::StrFormat("%s: %s", path, file.status().message())),
                       path);
}

GivenExposures GivenExposures::each(std::string path, ExposureFile file) {
  GivenExposures given;
  given.path_ = std::move(path);
  given.frames_ = std::move(file.frames);
  return given;
}

GivenExposures GivenExposures::locked(double exposure) {
  GivenExposures given;
  given.locked_ = exposure;
  return given;
}

absl::StatusOr<std::optional<double>> GivenExposures::of(int64_t frame) const {
  if (path_.empty()) return locked_;
  const auto at =
      std::lower_bound(frames_.begin(), frames_.end(), frame,
                       [](const ExposedFrame& one, int64_t number) { return one.frame < number; });
  if (at != frames_.end() && at->frame == frame) return at->exposure;
  return input_failure(
      absl::InvalidArgumentError(absl::StrFormat(
          "%s has no exposure for frame %d; it has frames from %d to %d, so meter the whole shot", path_,
          frame, frames_.front().frame, frames_.back().frame)),
      path_);
}

absl::StatusOr<ShotExposures> ShotExposures::open(const StreamOptions& options) {
  ShotExposures shot(options);
  // The options refuse more than one of them.
  for (const std::string& path : {options.exposures, options.locked_exposure, options.state}) {
    if (!path.empty()) shot.path_ = path;
  }
  if (shot.path_.empty()) return shot;
  ASSIGN_OR_RETURN(ExposureFile file, read_exposures(shot.path_));
  if (!options.locked_exposure.empty()) {
    shot.given_ = GivenExposures::locked(file.locked);
    return shot;
  }
  if (!options.exposures.empty()) shot.given_ = GivenExposures::each(shot.path_, file);
  shot.read_ = std::move(file);
  return shot;
}

absl::Status ShotExposures::prepare_save() const {
  if (!saved()) return absl::OkStatus();
  absl::Status status = replaces_only_json("--save-exposures", options_.save_exposures);
  status.Update(make_folder_of(options_.save_exposures));
  if (!status.ok()) return status;
  return writable_destination(options_.save_exposures).status();
}

absl::StatusOr<SequenceChoice> ShotExposures::choice() const {
  SequenceChoice choice = options_.sequence;
  if (!read_) return choice;
  if (choice.rate && *choice.rate != read_->rate) {
    return usage_error(absl::StrFormat("--fps is %s and %s was made at %s; leave --fps out, or make it again",
                                       to_text(*choice.rate), path_, to_text(read_->rate)));
  }
  choice.rate = rate();
  choice.zero = read_->zero;
  choice.after = after();
  return choice;
}

absl::StatusOr<std::vector<std::string>> ShotExposures::check(const Sequence& sequence) const {
  std::vector<std::string> notes;
  if (!options_.skip_bad) {
    for (const SequenceFrame& frame : sequence.frames) {
      RETURN_IF_ERROR(given_.of(frame.number).status());
    }
  }
  if (options_.state.empty()) return notes;
  RETURN_IF_ERROR(check_after_state(sequence));
  if (options_.cut_threshold_ev > 0 && read_->state.picture().empty()) {
    notes.push_back(absl::StrFormat("%s was made without --detect-cuts, so no cut is detected at frame %d",
                                    path_, sequence.first()));
  }
  if (options_.lookahead > 0 || read_->lookahead > 0) {
    notes.push_back(absl::StrFormat(
        "the last frames of %s did not look ahead to frame %d; for the images of one run, meter the whole "
        "shot and give --exposures",
        path_, sequence.first()));
  }
  return notes;
}

absl::Status ShotExposures::check_after_state(const Sequence& sequence) const {
  const int64_t last = read_->last();
  if (sequence.first() > last) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrFormat("%s ends after frame %d and the first frame here is %d; begin later, with --range %d-",
                      path_, last, sequence.first(), last + 1));
}

std::optional<v1::SessionState> ShotExposures::state() const {
  if (options_.state.empty()) return std::nullopt;
  return read_->state;
}

std::optional<int64_t> ShotExposures::after() const {
  if (options_.state.empty()) return std::nullopt;
  return read_->last();
}

absl::Status ShotExposures::save(const Sequence& sequence, FrameRate rate,
                                 const std::vector<ExposedFrame>& frames,
                                 const v1::SessionState& state) const {
  const v1::Exposure& settings = options_.settings.exposure();
  const ExposureFile saved{.rate = rate,
                           .zero = sequence.zero,
                           .settings = settings,
                           .lookahead = options_.lookahead,
                           .cut_threshold_ev = options_.cut_threshold_ev,
                           .frames = frames,
                           .locked = locked_exposure(settings, frames),
                           .state = state};
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(options_.save_exposures));
  const std::string text = to_text(saved);
  file.write(text.data(), text.size());
  return file.commit();
}

}  // namespace candela
