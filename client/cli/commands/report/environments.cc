#include "client/cli/commands/report/environments.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/commands/report/samples.h"
#include "client/run/frame_files.h"
#include "client/run/panorama_file.h"
#include "client/run/view_scene.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Ends the wait for a server that never answers.
constexpr absl::Duration kBakeTimeout = absl::Minutes(30);

constexpr int kTimedBakes = 5, kQuickTimedBakes = 3;  // timed, after a warm-up
constexpr double kSlowMs = 2000;                      // a slower bake is timed once

// After a bake that took longer, --quick skips the other tiers; the most accurate one takes some ten times as
// long.
constexpr double kLongestQuickMs = 5000;

// --quick bakes cube maps no larger than this, and measures no errors of larger panoramas.
constexpr uint32_t kQuickCubeSize = 128;
constexpr uint64_t kQuickTexels = 1024 * 512;

constexpr uint32_t kViewWidth = 640, kViewHeight = 360;

using Clock = std::chrono::steady_clock;

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
    return session_.server().bake_environment(request, absl::Now() + kBakeTimeout);
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
      if (i == 0 && ms > kSlowMs) {
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
                     session_.server().render(settings, frame, absl::Now() + kBakeTimeout));
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
      session.server().put_environment(*panorama.panorama, absl::Now() + kBakeTimeout);
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
  if (!put->had_it()) session.server().drop_environment(put->id(), absl::Now() + kBakeTimeout).IgnoreError();
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
