#include "client/run/view_run.h"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/run/frame_numbers.h"
#include "client/run/frame_sinks.h"
#include "client/run/frame_source.h"
#include "client/run/options.h"
#include "client/run/panorama_file.h"
#include "client/run/picture_frame.h"
#include "client/run/picture_run.h"
#include "client/run/run.h"
#include "client/run/server_link.h"
#include "client/run/session_run.h"
#include "client/run/view_scene.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The frames of a camera that moves in a panorama.
class ViewFrames : public FrameSource {
 public:
  // `environment` is the id of the panorama `file` on the server. `exposure` is that of all frames, if it is
  // given. The options, the scene and the file must outlive this.
  ViewFrames(const PanoramaViewOptions& options, const ViewScene& scene, const PanoramaFile& file,
             std::string environment, std::optional<double> exposure, v1::Settings settings)
      : options_(options),
        scene_(scene),
        file_(file),
        environment_(std::move(environment)),
        exposure_(exposure),
        settings_(std::move(settings)),
        defaults_(show_as_it_is(file.light, file.peak, {.exposure = exposure, .defaults = options.defaults},
                                settings_)) {}

  uint64_t frames() const override { return scene_.frames(); }
  std::optional<SourceFrame> next() override;

 private:
  const PanoramaViewOptions& options_;
  const ViewScene& scene_;
  const PanoramaFile& file_;
  const std::string environment_;
  const std::optional<double> exposure_;
  v1::Settings settings_;
  const PictureDefaults defaults_;
  uint64_t next_ = 0;
};

std::optional<SourceFrame> ViewFrames::next() {
  if (next_ == scene_.frames()) return std::nullopt;
  const uint64_t index = next_++;
  SourceFrame made;
  made.settings = settings_;
  made.facts = {
      .number = static_cast<int64_t>(index),
      .input = options_.panorama,
      .place = index,
      .media_time_ns = media_time_ns(index, scene_.rate()),
      .exposure_given = exposure_.has_value(),
      .size = {options_.width, options_.height},
      .pixel_aspect = image_pixel_aspect({options_.width, options_.height}, 1, settings_.output_size()),
      .frame_rate = scene_.rate(),
      .primaries = file_.primaries,
      .defaults = defaults_,
      .missing_pixels = file_.missing_pixels};
  made.frame = {.width = options_.width,
                .height = options_.height,
                .sequence = index,
                .media_time_ns = made.facts.media_time_ns,
                .exposure = exposure_,
                .view = scene_.view(environment_, index),
                .panorama = file_.panorama};
  return made;
}

// Ends the wait for a server that never answers.
constexpr absl::Duration kViewTimeout = absl::Minutes(30);

absl::StatusOr<PanoramaFile> read(const PanoramaViewOptions& options, Run& run, RunEvents& events) {
  events.begins("reading " + options.panorama);
  ASSIGN_OR_RETURN(const v1::Limits limits, run.limits());
  return read_panorama(options.panorama, options, limits, run.view().get());
}

absl::Status named(const absl::Status& status, const PanoramaViewOptions& options) {
  return name_file(in_options(status, options.settings), options.panorama);
}

// The run of a single view.
class ViewRun {
 public:
  // `run` has its exposure and its view.
  ViewRun(const PanoramaViewOptions& options, const ViewScene& scene, Run& run, RunEvents& events,
          absl::Time begin)
      : options_(options),
        scene_(scene),
        run_(run),
        events_(events),
        picture_(options, options.verify, options.panorama, options.output, run, events, begin) {}

  absl::StatusOr<RenderReport> render() {
    settings_ = without_panorama(options_.settings);
    if (run_.view() != nullptr) {
      picture_.add_stage("ocio", run_.bake_ms());
      show_by(*run_.view(), settings_);
    }
    RETURN_IF_ERROR(read_file());
    RETURN_IF_ERROR(run_.connect());
    if (run_.start_ms() > 0) picture_.add_stage("start", run_.start_ms());
    ASSIGN_OR_RETURN(const Image rendered, call());
    RETURN_IF_ERROR(picture_.write(rendered));
    RETURN_IF_ERROR(picture_.write_error_map());
    return picture_.finish();
  }

 private:
  absl::Status read_file() {
    const absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(PanoramaFile file, read(options_, run_, events_));
    picture_.add_stage("read", ms_since(begin));
    picture_.report().primaries = file.primaries;
    picture_.report().missing_pixels = file.missing_pixels;
    picture_.add_notes(std::move(file.notes));
    panorama_ = std::move(file.panorama);
    const PictureDefaults defaults = show_as_it_is(file.light, file.peak,
                                                   {.exposure = run_.locked(),
                                                    .adapts = options_.previous.exposure() > 0,
                                                    .defaults = options_.defaults},
                                                   settings_);
    picture_.show({settings_, defaults, {}});
    return absl::OkStatus();
  }

  absl::StatusOr<Image> call() {
    const absl::Time deadline = absl::Now() + kViewTimeout;
    absl::StatusOr<RenderResult> result;
    const absl::Status status = run_.link().call(deadline, [&](const Connection& server) {
      result = call_on(server, deadline);
      return result.status();
    });
    if (!status.ok()) return named(status, options_);
    panorama_.reset();
    run_.close();
    picture_.add_note(bad_values_);
    picture_.take(*result, settings_, size());
    const v1::OutputSize& asked = settings_.output_size();
    return picture_of(*std::move(result), /*has_alpha=*/false, image_pixel_aspect(size(), 1, asked));
  }

  // Both calls go to the same server, because another one may not have the panorama.
  absl::StatusOr<RenderResult> call_on(const Connection& server, absl::Time deadline) {
    events_.begins("sending " + options_.panorama);
    absl::Time begin = absl::Now();
    ASSIGN_OR_RETURN(const v1::Environment environment, server.put_environment(*panorama_, deadline));
    picture_.report().environment = environment.id();
    bad_values_ = bad_values_note(environment);
    const double put_ms = ms_since(begin);
    events_.begins(
        absl::StrFormat("rendering %s; the first view of a panorama takes longer", options_.output));
    begin = absl::Now();
    absl::StatusOr<RenderResult> result = server.render(settings_, frame(environment.id()), deadline);
    if (result.ok()) {
      picture_.add_stage("put", put_ms);
      add_server_stages(result->header, ms_since(begin), picture_.report().stage_ms);
    }
    return result;
  }

  v1::ImageSize size() const { return {options_.width, options_.height}; }

  FrameView frame(const std::string& environment) const {
    FrameView frame;
    frame.width = options_.width;
    frame.height = options_.height;
    frame.view = scene_.view(environment, 0);
    frame.exposure = run_.locked();
    if (options_.previous.exposure() > 0) frame.previous = options_.previous;
    frame.verify = options_.verify.verify;
    frame.error_map = !options_.verify.error_map.empty();
    return frame;
  }

  const PanoramaViewOptions& options_;
  const ViewScene& scene_;
  Run& run_;
  RunEvents& events_;
  PictureRun picture_;
  v1::Settings settings_;
  std::shared_ptr<const Panorama> panorama_;
  std::string bad_values_;  // a note about the panorama's, or ""
};

// The first server gets the panorama here. The session puts it on others, if it has to go there.
absl::StatusOr<v1::Environment> put(const PanoramaViewOptions& options, const Panorama& panorama, Run& run,
                                    RunEvents& events) {
  events.begins("sending " + options.panorama);
  RETURN_IF_ERROR(run.connect());
  const absl::Time deadline = absl::Now() + kViewTimeout;
  absl::StatusOr<v1::Environment> environment;
  const absl::Status status = run.link().call(deadline, [&](const Connection& server) {
    environment = server.put_environment(panorama, deadline);
    return environment.status();
  });
  if (!status.ok()) return named(status, options);
  return environment;
}

}  // namespace

absl::StatusOr<RenderReport> render_view(const PanoramaViewOptions& options, const ViewScene& scene,
                                         RunEvents& events) {
  const absl::Time begin = absl::Now();
  Run run(options, events);
  RETURN_IF_ERROR(run.read_exposure());
  RETURN_IF_ERROR(run.bake());
  return ViewRun(options, scene, run, events, begin).render();
}

absl::StatusOr<RunSummary> render_views(const PanoramaViewOptions& options, const ViewScene& scene,
                                        std::vector<std::string> outputs, RunEvents& events) {
  SessionRun views(options, events);
  RunSummary& summary = views.summary();
  summary.frames = scene.frames();
  summary.last = static_cast<int64_t>(scene.frames()) - 1;
  summary.rate = choose_rate(options.rate, std::nullopt);
  RETURN_IF_ERROR(views.prepare(without_panorama(options.settings)));
  v1::Settings settings = views.session().settings;  // as the view shows them
  settings.clear_table();                            // the session's
  RETURN_IF_ERROR(views.run().read_exposure());
  ASSIGN_OR_RETURN(const PanoramaFile file, read(options, views.run(), events));
  summary.notes.insert(file.notes.begin(), file.notes.end());
  ASSIGN_OR_RETURN(const v1::Environment environment, put(options, *file.panorama, views.run(), events));
  if (const std::string bad = bad_values_note(environment); !bad.empty()) summary.notes.insert(bad);
  ViewFrames frames(options, scene, file, environment.id(), views.run().locked(), std::move(settings));
  ImageFiles images([&outputs](const FrameFacts& frame) { return outputs.at(frame.place); }, options.write,
                    events, summary);
  RETURN_IF_ERROR(views.render(frames, images));
  summary.locked = locked_exposure(options.settings.exposure(), summary.curve);
  return std::move(summary);
}

}  // namespace candela
