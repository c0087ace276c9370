#include "client/cli/environment/view_sequence.h"

#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/cli/commands/render/gamut_note.h"
#include "client/cli/commands/render/held_exposure.h"
#include "client/cli/commands/render/render_report.h"
#include "client/cli/commands/server_link.h"
#include "client/cli/commands/stream/stream_images.h"
#include "client/cli/environment/panorama_file.h"
#include "client/cli/files/exposure_file.h"
#include "client/cli/files/sequence/frame_files.h"
#include "client/cli/files/sequence/sequence_files.h"
#include "client/cli/options/words/option_words.h"
#include "client/image/encodings.h"
#include "client/session.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// Ends the wait for a server that never answers.
constexpr absl::Duration kPutTimeout = absl::Minutes(30);

// One thread submits views and takes their images, because a view has next to no bytes.
class ViewSequence {
 public:
  ViewSequence(const PanoramaViewOptions& options, const ViewScene& scene, OutputNames names,
               JsonOutput& json, Progress& progress)
      : options_(options),
        scene_(scene),
        names_(std::move(names)),
        progress_(progress),
        link_(options.server, options.quiet),
        images_(options.write, options.quiet, json, progress, summary_) {}

  absl::StatusOr<StreamSummary> run() {
    summary_.frames = scene_.frames();
    summary_.last = static_cast<int64_t>(scene_.frames()) - 1;
    summary_.rate = choose_rate(options_.rate, std::nullopt);
    SessionOptions session;
    absl::Status status = prepare(session.settings);
    if (status.ok()) status = read();
    if (status.ok()) status = put();
    if (status.ok()) status = stream(std::move(session));
    status.Update(images_.finish());
    if (!status.ok()) return status;
    summary_.time = absl::Now() - begin_;
    summary_.locked = locked_exposure(options_.settings.exposure(), summary_.curve);
    return std::move(summary_);
  }

 private:
  absl::Status prepare(v1::Settings& settings) {
    settings = without_panorama(options_.settings);
    summary_.defaults = options_.defaults;
    if (!options_.view.config.empty()) {
      progress_.show("baking " + options_.view.config);
      ASSIGN_OR_RETURN(BakedView baked, bake(options_));
      show_by(baked, settings);
      summary_.notes.insert(baked.notes.begin(), baked.notes.end());
      summary_.view = view_words(baked.report);
      view_ = std::move(baked);
    }
    if (!options_.locked_exposure.empty()) {
      ASSIGN_OR_RETURN(const ExposureFile file, read_exposures(options_.locked_exposure));
      exposure_given_ = file.locked;
    }
    return link_.check_tier(settings.tier());
  }

  absl::Status read() {
    progress_.show("reading " + options_.panorama);
    ASSIGN_OR_RETURN(const v1::Limits limits, link_.limits());
    ASSIGN_OR_RETURN(PanoramaFile file,
                     read_panorama(options_.panorama, options_, limits, view_ ? &*view_ : nullptr));
    summary_.notes.insert(file.notes.begin(), file.notes.end());
    summary_.primaries.insert(words_of(file.primaries));
    file_ = std::move(file);
    return absl::OkStatus();
  }

  // The first server gets the panorama here. The session puts it on others, if it has to go there.
  absl::Status put() {
    progress_.show("sending " + options_.panorama);
    if (const auto server = link_.connection(); !server.ok()) return server.status();
    const absl::Time deadline = absl::Now() + kPutTimeout;
    absl::StatusOr<v1::Environment> environment;
    const absl::Status status = link_.call(deadline, [&](const Connection& server) {
      environment = server.put_environment(*file_.panorama, deadline);
      return environment.status();
    });
    if (!status.ok()) return named(status);
    environment_ = environment->id();
    const std::string bad = bad_values_note(*environment);
    if (!bad.empty()) summary_.notes.insert(bad);
    return absl::OkStatus();
  }

  absl::Status stream(SessionOptions options) {
    settings_ = options.settings;
    options.name = options_.session;
    options.lookahead = options_.lookahead;
    options.encoding = options_.encoding;
    options.jpeg_quality = static_cast<uint32_t>(options_.write.jpeg_quality);
    progress_.show("opening a session");
    absl::StatusOr<Session> session = link_.open_session(options);
    if (!session.ok()) return in_options(session.status(), options_.settings);
    begin_ = absl::Now();
    absl::Status status = exchange(*session);
    if (!status.ok()) session->cancel();
    if (status.ok()) status = images_.finish();
    summary_.session = session->stats();
    return status;
  }

  absl::Status exchange(Session& session) {
    uint64_t submitted = 0;
    while (true) {
      while (submitted < scene_.frames() && session.ready()) {
        // If submit() fails, the session has ended, and its results say why.
        if (!session.submit(frame(submitted)).ok()) break;
        if (++submitted == scene_.frames()) session.finish();
      }
      absl::StatusOr<std::optional<FrameResult>> result = session.next_result();
      if (!result.ok()) return named(result.status());
      if (!*result) return absl::OkStatus();
      tell_of_resume(session);
      RETURN_IF_ERROR(take(**result));
    }
  }

  SessionFrame frame(uint64_t index) const {
    SessionFrame frame;
    frame.width = options_.width;
    frame.height = options_.height;
    frame.view = scene_.view(environment_, index);
    frame.panorama = file_.panorama;
    frame.sequence = index;
    frame.media_time_ns = media_time_ns(index, scene_.rate());
    frame.exposure = exposure_given_;
    return frame;
  }

  absl::Status take(FrameResult& result) {
    if (!result.status.ok()) return named(result.status);
    StreamFrame frame;
    frame.number = static_cast<int64_t>(result.sequence);
    frame.input = options_.panorama;
    frame.output = names_.path(frame.number, "");
    frame.media_time_ns = media_time_ns(result.sequence, scene_.rate());
    frame.primaries = file_.primaries;
    frame.missing_pixels = file_.missing_pixels;
    frame.header = result.image.header;
    frame.latency = result.latency;
    add_notes_on(frame.header);
    summary_.curve.push_back({.frame = frame.number,
                              .media_time_ns = frame.media_time_ns,
                              .exposure = frame.header.exposure(),
                              .target = frame.header.target(),
                              .mean_log2_luminance = frame.header.statistics().mean_log2_luminance(),
                              .cut = frame.header.cut()});
    show(frame);
    FrameFacts facts;
    facts.frame_rate = scene_.rate();
    return images_.write(std::move(frame), std::move(result.image), facts);
  }

  // Once a sequence, because the numbers are others for each frame.
  void add_notes_on(const v1::ResultHeader& header) {
    const auto say_once = [&](bool& said, const std::string& words) {
      if (!words.empty() && !std::exchange(said, true)) summary_.notes.insert(words);
    };
    if (!view_ || !view_->view.as_is) say_once(said_gamut_, gamut_note(header, settings_).value_or(""));
    if (!exposure_given_) say_once(said_held_, held_words(header.target(), header.target_before_limits()));
  }

  absl::Status named(const absl::Status& status) const {
    return name_file(in_options(status, options_.settings), options_.panorama);
  }

  void tell_of_resume(const Session& session) {
    const SessionStats stats = session.stats();
    if (stats.resumes == resumes_) return;
    resumes_ = stats.resumes;
    progress_.clear();
    if (!options_.quiet) print_note(resume_words(stats));
  }

  void show(const StreamFrame& frame) {
    const auto done = static_cast<double>(frame.number + 1), all = static_cast<double>(scene_.frames());
    const double seconds = absl::ToDoubleSeconds(absl::Now() - begin_);
    progress_.show_bar(
        done / all, absl::StrFormat("%d/%d, %.1f fps, exposure %s, %.0f s left", frame.number + 1,
                                    scene_.frames(), done / seconds, exposure_words(frame.header.exposure()),
                                    seconds / done * (all - done)));
  }

  const PanoramaViewOptions& options_;
  const ViewScene& scene_;
  const OutputNames names_;
  Progress& progress_;
  ServerLink link_;
  StreamSummary summary_;
  StreamImages images_;
  PanoramaFile file_;
  std::string environment_;  // its id
  v1::Settings settings_;
  std::optional<BakedView> view_;
  std::optional<double> exposure_given_;
  absl::Time begin_;
  bool said_gamut_ = false;
  bool said_held_ = false;
  uint64_t resumes_ = 0;
};

}  // namespace

absl::StatusOr<StreamSummary> render_view_sequence(const PanoramaViewOptions& options, const ViewScene& scene,
                                                   JsonOutput& json, Progress& progress) {
  ASSIGN_OR_RETURN(OutputNames names,
                   OutputNames::parse(options.output, output_encoding(options.encoding).extension()));
  return ViewSequence(options, scene, std::move(names), json, progress).run();
}

}  // namespace candela
