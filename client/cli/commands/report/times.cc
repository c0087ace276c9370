#include "client/cli/commands/report/times.h"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/commands/report/session.h"
#include "client/run/panorama_file.h"
#include "client/run/picture_frame.h"
#include "client/run/view_scene.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr int kWarmUp = 2;
constexpr double kSlowMs = 2000;          // a slower frame is timed less often, without a warm-up
constexpr double kLongestMs = 30000;      // a slower frame is skipped
constexpr double kSceneMegapixels = 2.1;  // the largest size for measure_scenes()

using Clock = std::chrono::steady_clock;

// The times of several frames.
struct Samples {
  std::vector<double> device, call, copy;  // ms
  StageTimes stages;
  std::vector<std::string> plan;  // the plan of the last frame

  void add(const v1::ResultHeader& header) {
    device.push_back(device_ms(header.stages()));
    plan.assign(header.plan().begin(), header.plan().end());
    stages.add(header.stages());
  }

  Json json() const {
    return {{"frames", device.size()},
            {"device_ms", spread(device)},
            {"call_ms", spread(call)},
            {"memcpy_ms", spread(copy)},
            {"memcpy_ratio", quantile(device, 0.5) / std::max(1e-6, quantile(copy, 0.5))},
            {"stages", stages.json()}};
  }
};

// Times a plain copy of the frame, next to every timed frame: the cost of touching its memory.
class Yardstick {
 public:
  explicit Yardstick(const Image& frame) : frame_(frame), copy_(frame.bytes()) {
    copy_ms();  // the first copy also pays for the page faults
  }

  double copy_ms() {
    if (copy_.empty()) return 0;
    const Clock::time_point begin = Clock::now();
    std::memcpy(copy_.data(), frame_.pixels.data(), frame_.bytes());
    asm volatile("" ::"r"(copy_.data()) : "memory");  // so that the compiler keeps the copy
    return ms_since(begin);
  }

 private:
  const Image& frame_;
  PixelBuffer copy_;
};

absl::StatusOr<Samples> time_frames(const ReportSession& session, const v1::Settings& settings,
                                    const Image& frame, const TimePlan& plan) {
  Samples samples;
  Yardstick yardstick(frame);
  int warm_up = kWarmUp, frames = plan.frames;
  for (int i = 0; i < warm_up + frames; ++i) {
    const double copy = yardstick.copy_ms();
    const Clock::time_point begin = Clock::now();
    ASSIGN_OR_RETURN(const RenderResult result, session.render(settings, frame));
    const double call = ms_since(begin);
    if (i == 0 && device_ms(result.header.stages()) > kSlowMs) {
      warm_up = 0;
      frames = std::min(frames, plan.slow_frames);
    }
    if (i < warm_up) continue;
    samples.add(result.header);
    samples.call.push_back(call);
    samples.copy.push_back(copy);
  }
  return samples;
}

// The times of a tier at the previous size, from which the times at the next one are estimated.
struct Seen {
  double megapixels = 0;
  double frame_ms = 0;
  double verify_ms = 0;  // for the whole call

  Seen at(const FrameSize& size) const {
    const double ratio = megapixels > 0 ? size.megapixels / megapixels : 0;
    return {size.megapixels, frame_ms * ratio, verify_ms * ratio};
  }
};

// Why work that takes about `ms` has to be skipped, "" if there is time for it.
std::string too_late(const TimePlan& plan, double ms) {
  const double left_ms = absl::ToDoubleMilliseconds(plan.deadline - absl::Now());
  if (ms <= left_ms) return "";
  return absl::StrFormat("would take about %.0f s, but --quick has only %.0f s left", ms / 1000,
                         std::max(0.0, left_ms) / 1000);
}

std::string too_slow(const TimePlan& plan, const Seen& expected) {
  if (expected.frame_ms > kLongestMs) {
    return absl::StrFormat("would take about %.0f s per frame; the limit is %.0f s", expected.frame_ms / 1000,
                           kLongestMs / 1000);
  }
  const int frames = expected.frame_ms > kSlowMs ? plan.slow_frames : kWarmUp + plan.frames;
  return too_late(plan, frames * expected.frame_ms);
}

void add_error(const ReportSession& session, const TimePlan& plan, const Image& frame, Seen& seen,
               Json& row) {
  const std::string late = too_late(plan, seen.verify_ms);
  if (!late.empty()) {
    row["error_skipped"] = "the error " + late;
    return;
  }
  const Clock::time_point begin = Clock::now();
  const absl::StatusOr<RenderResult> result =
      session.render(ReportSession::settings(row["tier"]), frame, {.verify = true});
  if (!result.ok()) {
    row["error_skipped"] = std::string(result.status().message());
    return;
  }
  seen.verify_ms = ms_since(begin);
  const v1::Verification& v = result->header.verify();
  row["error"] = {{"max_codes", json_number(v.max_error_codes())},
                  {"p999_codes", json_number(v.p999_error_codes())},
                  {"mean_codes", json_number(v.mean_error_codes())}};
}

// Measures one size at one tier. `seen` holds the expected times and receives the measured ones.
Json time_row(const ReportSession& session, const TimePlan& plan, const Image& frame, Seen& seen, Json row) {
  const absl::StatusOr<Samples> samples =
      time_frames(session, ReportSession::settings(row["tier"]), frame, plan);
  if (!samples.ok()) {
    row["skipped"] = std::string(samples.status().message());
    return row;
  }
  seen.frame_ms = quantile(samples->device, 0.5);
  row.update(samples->json());
  add_error(session, plan, frame, seen, row);
  return row;
}

// Why the server refuses a size, "" if it does not.
std::string beyond_limits(const v1::Limits& limits, const FrameSize& size) {
  const uint64_t bytes = uint64_t{size.width} * size.height * bytes_per_pixel(ImageFormat::kRgba16f);
  if (std::max(size.width, size.height) > limits.max_dimension()) {
    return absl::StrFormat("exceeds this server's limit of %d pixels per side", limits.max_dimension());
  }
  if (bytes <= limits.max_frame_bytes()) return "";
  return absl::StrFormat("%d bytes exceed this server's limit of %d for a frame", bytes,
                         limits.max_frame_bytes());
}

Json blank_row(const FrameSize& size, const std::string& tier) {
  return {{"megapixels", size.megapixels}, {"width", size.width}, {"height", size.height}, {"tier", tier}};
}

// A frame, its settings, and their description.
struct Scene {
  std::string what;
  const absl::StatusOr<Image>& frame;
  v1::Settings settings;
};

Json scene_row(const ReportSession& session, const TimePlan& plan, const Scene& scene) {
  Json row = {{"what", scene.what}};
  const absl::StatusOr<Samples> samples =
      scene.frame.ok() ? time_frames(session, scene.settings, *scene.frame, plan) : scene.frame.status();
  if (!samples.ok()) {
    row["error"] = std::string(samples.status().message());
    return row;
  }
  row["width"] = scene.frame->width;
  row["height"] = scene.frame->height;
  row["plan"] = samples->plan;
  row.update(samples->json());
  return row;
}

}  // namespace

Json measure_times(const ReportSession& session, const TimePlan& plan) {
  Json rows = Json::array();
  std::map<std::string, Seen> seen;
  for (const FrameSize& size : plan.sizes) {
    session.show(absl::StrFormat("times: making %dx%d", size.width, size.height));
    std::string why = beyond_limits(session.info().limits(), size);
    const absl::StatusOr<Image> frame = why.empty() ? sample_frame(size.width, size.height) : Image();
    if (!frame.ok()) why = std::string(frame.status().message());
    for (const std::string& tier : session.tiers()) {
      Json row = blank_row(size, tier);
      Seen expected = seen[tier].at(size);
      const std::string reason = why.empty() ? too_slow(plan, expected) : why;
      if (!reason.empty()) {
        row["skipped"] = reason;
        rows.push_back(std::move(row));
        continue;
      }
      session.show(absl::StrFormat("times: %s at %dx%d", tier, size.width, size.height));
      rows.push_back(time_row(session, plan, *frame, expected, std::move(row)));
      if (rows.back().contains("device_ms")) seen[tier] = expected;
    }
  }
  return rows;
}

Json measure_scenes(const ReportSession& session, const TimePlan& plan) {
  session.show("what scenes cost");
  FrameSize size = plan.sizes.front();
  for (const FrameSize& other : plan.sizes) {
    if (other.megapixels <= kSceneMegapixels) size = other;
  }
  const auto all_failed = [](const std::string& why) {
    return Json::array({{{"what", "all"}, {"error", why}}});
  };
  if (const std::string why = beyond_limits(session.info().limits(), size); !why.empty()) {
    return all_failed(absl::StrFormat("%dx%d: %s", size.width, size.height, why));
  }
  const absl::StatusOr<Image> frame = sample_frame(size.width, size.height);
  constexpr float kDim = 0.25f;  // below the knee of the default threshold
  const absl::StatusOr<Image> dim = sample_frame(size.width, size.height, kDim);
  if (!frame.ok() || !dim.ok()) {
    const absl::Status& status = frame.ok() ? dim.status() : frame.status();
    return all_failed(std::string(status.message()));
  }
  const absl::StatusOr<Image> few = with_few_lights(*dim);
  const absl::StatusOr<Image> dirty = with_one_nan(*frame);
  const v1::Settings usual = ReportSession::settings(session.bounded_tier());
  std::vector<Scene> scenes = {{"the sample scene", frame, usual},
                               {"five small lights", few, usual},
                               {"nothing bright", dim, usual},
                               {"one NaN", dirty, usual}};
  if (session.has_tier("draft")) {
    const v1::Settings draft = ReportSession::settings("draft");
    scenes.push_back({"tier draft", frame, draft});
    scenes.push_back({"tier draft, nothing bright", dim, draft});
  }
  for (const char* word : {"aces-1", "aces-2"}) {
    const std::optional<v1::ToneCurve> aces = session.curve(word);
    if (!aces) continue;
    scenes.push_back({absl::StrCat("curve ", word), frame, usual});
    scenes.back().settings.set_curve(*aces);
  }
  Json rows = Json::array();
  for (const Scene& scene : scenes) rows.push_back(scene_row(session, plan, scene));
  return rows;
}

namespace {

// Ends the wait for a server that never answers.
constexpr absl::Duration kReportBakeTimeout = absl::Minutes(30);

constexpr int kTimedBakes = 5, kQuickTimedBakes = 3;  // timed, after a warm-up
constexpr double kSlowBakeMs = 2000;                  // a slower bake is timed once

// After a bake that took longer, --quick skips the other tiers; the most accurate one takes some ten times as
// long.
constexpr double kLongestQuickMs = 5000;

// --quick bakes cube maps no larger than this, and measures no errors of larger panoramas.
constexpr uint32_t kQuickCubeSize = 128;
constexpr uint64_t kQuickTexels = 1024 * 512;

constexpr uint32_t kViewWidth = 640, kViewHeight = 360;

// Measures one panorama that is on the server.
class EnvironmentWork {
 public:
  EnvironmentWork(const ReportSession& session, const BakePlan& plan, const std::string& name,
                  const v1::Environment& environment)
      : session_(session), plan_(plan), name_(name), environment_(environment) {}

  Json bake_row(const std::string& tier) {
    session_.show(absl::StrFormat("environment: %s, %s", name_, tier));
    Json row = {{"panorama", name_}, {"tier", tier}, {"size", cube_size()}};
    if (const std::string why = too_late(); !why.empty()) {
      row["skipped"] = why;
      return row;
    }
    if (const absl::Status status = time_bakes(tier, row); !status.ok()) {
      row["skipped"] = std::string(status.message());
      return row;
    }
    add_errors(tier, row);
    return row;
  }

  // Writes the sheet of the levels, if there was a bake at the bounded tier, and the view.
  absl::Status write_pictures(size_t number, Json& row) const {
    session_.show(absl::StrFormat("environment: pictures of %s", name_));
    if (shown_) {
      const absl::StatusOr<Image> sheet = render_sheet();
      RETURN_IF_ERROR(write(sheet, levels_name(number), "levels", row));
    }
    return write(render_lookdev(), lookdev_name(number), "lookdev", row);
  }

 private:
  // Why --quick skips the next tier, "" if it does not.
  std::string too_late() const {
    if (absl::Now() > plan_.deadline) return "--quick has no time left";
    if (!plan_.quick || slowest_ms_ <= kLongestQuickMs) return "";
    return absl::StrFormat("--quick skips it, because a bake at another tier took %.1f s",
                           slowest_ms_ / 1000);
  }

  uint32_t cube_size() const {
    const uint32_t usual = environment_.default_cube_size();
    return plan_.quick ? std::min(usual, kQuickCubeSize) : usual;
  }

  absl::StatusOr<EnvironmentBake> bake(const std::string& tier, bool verify) const {
    v1::BakeEnvironmentRequest request;
    request.set_id(environment_.id());
    request.set_size(cube_size());
    request.set_format(v1::PIXEL_FORMAT_RGBA16F);
    request.set_tier(tier);
    request.set_verify(verify);
    return session_.server().bake_environment(request, absl::Now() + kReportBakeTimeout);
  }

  absl::Status time_bakes(const std::string& tier, Json& row) {
    int warm_up = 1, bakes = plan_.quick ? kQuickTimedBakes : kTimedBakes;
    std::vector<double> device, call;
    StageTimes stages;
    for (int i = 0; i < warm_up + bakes; ++i) {
      const Clock::time_point begin = Clock::now();
      ASSIGN_OR_RETURN(EnvironmentBake baked, bake(tier, /*verify=*/false));
      const double ms = device_ms(baked.header.stages());
      slowest_ms_ = std::max(slowest_ms_, ms);
      if (i == 0 && ms > kSlowBakeMs) {
        warm_up = 0;
        bakes = 1;
      }
      if (i < warm_up) continue;
      device.push_back(ms);
      call.push_back(ms_since(begin));
      stages.add(baked.header.stages());
      if (tier == session_.bounded_tier()) shown_ = std::move(baked);
    }
    row.update({{"bakes", device.size()},
                {"device_ms", spread(device)},
                {"call_ms", spread(call)},
                {"stages", stages.json()}});
    return absl::OkStatus();
  }

  void add_errors(const std::string& tier, Json& row) const {
    if (plan_.quick && uint64_t{environment_.width()} * environment_.height() > kQuickTexels) {
      row["error_skipped"] = "--quick measures no error of a panorama larger than 1024x512";
      return;
    }
    const absl::StatusOr<EnvironmentBake> verified = bake(tier, /*verify=*/true);
    if (!verified.ok()) {
      row["error_skipped"] = std::string(verified.status().message());
      return;
    }
    Json levels = Json::array();
    double most = 0;
    for (const v1::BakedLevel& level : verified->header.levels()) {
      levels.push_back(
          {{"size", level.size()}, {"roughness", level.roughness()}, {"error", json_number(level.error())}});
      most = std::max(most, level.error());
    }
    row["levels"] = std::move(levels);
    row["max_error"] = json_number(most);
  }

  absl::StatusOr<Image> render_sheet() const {
    ASSIGN_OR_RETURN(const BakedEnvironment baked, environment_from(*shown_, Handedness::kLeft));
    ASSIGN_OR_RETURN(const Image sheet, environment_preview(baked));
    return picture(preview_settings(), view_of(sheet));
  }

  absl::StatusOr<Image> render_lookdev() const {
    ASSIGN_OR_RETURN(const std::vector<v1::Sphere> spheres, view_objects(kLookdev));
    FrameView frame{.width = kViewWidth, .height = kViewHeight};
    frame.view.emplace().set_environment(environment_.id());
    frame.view->mutable_objects()->Assign(spheres.begin(), spheres.end());
    return picture(ReportSession::settings(session_.bounded_tier()), frame);
  }

  absl::StatusOr<Image> picture(const v1::Settings& settings, const FrameView& frame) const {
    ASSIGN_OR_RETURN(RenderResult result,
                     session_.server().render(settings, frame, absl::Now() + kReportBakeTimeout));
    return picture_of(std::move(result), /*has_alpha=*/false, /*pixel_aspect=*/1);
  }

  // Names the file at `key`, or says why there is none. Fails only if it cannot be written.
  absl::Status write(const absl::StatusOr<Image>& picture, const std::string& file, const std::string& key,
                     Json& row) const {
    if (!picture.ok()) {
      row["error"] = std::string(picture.status().message());
      return absl::OkStatus();
    }
    row[key] = file;
    return write_image(absl::StrCat(plan_.folder, "/", file), *picture).status();
  }

  const ReportSession& session_;
  const BakePlan& plan_;
  const std::string& name_;
  const v1::Environment& environment_;
  double slowest_ms_ = 0;
  std::optional<EnvironmentBake> shown_;  // the last bake at the bounded tier
};

absl::Status measure_panorama(const ReportSession& session, const BakePlan& plan,
                              const ReportPanorama& panorama, EnvironmentRows& rows) {
  session.show("environment: sending " + panorama.name);
  Json row = {{"name", panorama.name},
              {"width", panorama.panorama->start.width()},
              {"height", panorama.panorama->start.height()}};
  const Clock::time_point begin = Clock::now();
  const absl::StatusOr<v1::Environment> put =
      session.server().put_environment(*panorama.panorama, absl::Now() + kReportBakeTimeout);
  if (!put.ok()) {
    row["error"] = std::string(put.status().message());
    rows.environments.push_back(std::move(row));
    return absl::OkStatus();
  }
  if (!put->had_it()) row["put_ms"] = ms_since(begin);
  EnvironmentWork work(session, plan, panorama.name, *put);
  for (const std::string& tier : session.tiers()) rows.bakes.push_back(work.bake_row(tier));
  const absl::Status written = work.write_pictures(rows.environments.size() + 1, row);
  rows.environments.push_back(std::move(row));
  // A panorama that others had put there is theirs. A failure costs the server memory, not this report.
  if (!put->had_it())
    session.server().drop_environment(put->id(), absl::Now() + kReportBakeTimeout).IgnoreError();
  return written;
}

std::string picture_name(size_t panorama, const char* what) {
  return absl::StrCat("panorama_", panorama, "_", what, ".png");
}

}  // namespace

std::string levels_name(size_t panorama) { return picture_name(panorama, "levels"); }
std::string lookdev_name(size_t panorama) { return picture_name(panorama, "lookdev"); }

absl::StatusOr<EnvironmentRows> measure_environments(const ReportSession& session,
                                                     const std::vector<ReportPanorama>& panoramas,
                                                     const BakePlan& plan) {
  EnvironmentRows rows;
  for (const ReportPanorama& panorama : panoramas) {
    RETURN_IF_ERROR(measure_panorama(session, plan, panorama, rows));
  }
  return rows;
}

}  // namespace candela
