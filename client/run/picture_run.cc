#include "client/run/picture_run.h"

#include <unistd.h>

#include <cstddef>
#include <iterator>
#include <span>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "client/base/failure.h"
#include "client/color/view_error.h"
#include "client/image/image.h"
#include "client/image/read/image_stream.h"
#include "client/image/write/encodings.h"
#include "client/run/hdr_gain_map.h"
#include "client/run/picture_error.h"
#include "client/run/picture_frame.h"
#include "client/run/server_link.h"
#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

// The word of the curve that the settings ask for.
std::string curve_word(v1::Settings settings) {
  (void)v1::complete_settings(settings);  // the default, if the user chose none; parsing has checked the rest
  return v1::word_of(settings.curve());
}

}  // namespace

PictureRun::PictureRun(const RunOptions& options, const VerifyChoice& verify, const std::string& input,
                       const std::string& output, const Run& run, RunEvents& events, absl::Time begin)
    : begin_(begin), options_(options), verify_(verify), run_(run), events_(events) {
  report_.input = input;
  report_.output = output;
  report_.error_map = verify.error_map;
  report_.notes = options.notes;
  if (run.view() == nullptr) return;
  report_.view = run.view()->report;
  report_.curve = report_.view->view;
  add_notes(run.view()->notes);
}

void PictureRun::show(const PictureSettings& made) {
  report_.defaults = made.defaults;
  report_.metered = made.settings.exposure().mode() != v1::Exposure::MODE_MANUAL && !run_.locked();
  if (!report_.view) report_.curve = curve_word(made.settings);
  kept_primaries_ = made.kept_primaries;
}

void PictureRun::add_note(std::string note) {
  if (!note.empty()) report_.notes.push_back(std::move(note));
}

void PictureRun::add_notes(std::vector<std::string> notes) {
  std::move(notes.begin(), notes.end(), std::back_inserter(report_.notes));
}

void PictureRun::take(RenderResult& result, const v1::Settings& settings, v1::ImageSize frame) {
  report_.header = result.header;
  report_.frame = frame;
  add_note(shape_note(frame, settings.output_size()));
  report_.tone_curve = settings.curve();
  report_.errors = error_parts(report_.header, settings);
  if (report_.errors && report_.view) report_.errors->table = report_.view->max_codes;
  error_map_ = std::move(result.error_map);
  if (!run_.locked()) {
    add_note(held_words(report_.header.target(), report_.header.target_before_limits()));
  }
  if (run_.shows_light())
    add_note(
        gamut_note(report_.header, settings, report_.defaults.light, options_.names_primaries).value_or(""));
}

absl::Status PictureRun::write(const Image& picture) {
  events_.begins("writing " + report_.output);
  const absl::Time begin = absl::Now();
  WriteOptions options = write_options_for(options_.write, report_.header, kept_primaries_);
  options.gain_map = report_.gain_map;
  ASSIGN_OR_RETURN(std::vector<std::string> notes,
                   report_.output == "-"
                       ? write_image_to_stdout(report_.output + options_.stdout_kind, picture, options)
                       : write_image(report_.output, picture, options));
  add_stage("write", ms_since(begin));
  add_notes(std::move(notes));
  const bool to_stdout = report_.output == "-";
  const auto encoding = output_encoding(to_stdout ? report_.output + options_.stdout_kind : report_.output);
  const bool lossy = encoding.ok() && (*encoding)->lossy;
  if (report_.errors) {
    report_.errors->lacks_file = lossy && to_stdout;
    // Over white, colour and alpha each have an error.
    const bool straight = options_.settings.alpha() == v1::ALPHA_STRAIGHT;
    if (picture.has_alpha && straight) report_.errors->rounding *= 2;
  }
  if (report_.errors && lossy && !to_stdout) {
    events_.begins("verifying " + report_.output);
    ASSIGN_OR_RETURN(const Image codes, read_codes(report_.output));
    ASSIGN_OR_RETURN(report_.file_error, error_of_file(report_.output, codes, picture));
    report_.errors->file = report_.file_error->max_codes;
    const std::optional<GainMapCodes> in_alpha = gain_map_in_alpha({.width = picture.width,
                                                                    .height = picture.height,
                                                                    .rows = picture.pixels.data(),
                                                                    .row_stride_bytes = picture.row_bytes()},
                                                                   options.gain_map_max_log2);
    if (const GainMapCodes* const map = in_alpha ? &*in_alpha : report_.gain_map.get()) {
      ASSIGN_OR_RETURN(report_.gain_map_error, error_of_gain_map(report_.output, codes, *map));
    }
  }
  return absl::OkStatus();
}

absl::Status PictureRun::write_error_map() const {
  if (verify_.error_map.empty()) return absl::OkStatus();
  events_.begins("writing " + verify_.error_map);
  return candela::write_error_map(verify_.error_map, error_map_, report_.header.width(),
                                  report_.header.height());
}

RenderReport PictureRun::finish() {
  report_.total_ms = ms_since(begin_);
  return std::move(report_);
}

namespace {

// Ends the wait for a server that never answers. The largest frame behind a full queue takes much less time.
constexpr absl::Duration kRenderTimeout = absl::Minutes(30);

// Renders one file: reads it, has the server render it, and writes the result.
class FrameRun {
 public:
  FrameRun(const RenderOptions& options, const RenderJob& job, bool only, Run& run, RunEvents& events)
      : options_(options),
        job_(job),
        only_(only),
        run_(run),
        events_(events),
        picture_(options, options.verify, job.input, job.output, run, events, absl::Now()) {}

  absl::StatusOr<RenderReport> run() {
    ASSIGN_OR_RETURN(Image image, read());
    picture_.report().primaries = primaries_of(image, options_.settings, view());
    picture_.report().missing_pixels = image.missing_pixels;
    ASSIGN_OR_RETURN(Image rendered, render(std::move(image)));
    if (job_.take) {
      job_.take(std::move(rendered));
      return picture_.finish();
    }
    RETURN_IF_ERROR(picture_.write(rendered));
    RETURN_IF_ERROR(picture_.write_error_map());
    return picture_.finish();
  }

 private:
  absl::StatusOr<Image> read_input() {
    ASSIGN_OR_RETURN(const v1::Limits limits, run_.limits());
    const ImageLimits most = image_limits(limits, options_);
    absl::StatusOr<Image> image =
        is_piped() ? read_piped_image(STDIN_FILENO, kStdinName, most, choice_of(options_, view()))
                   : read_image(job_.input, most, choice_of(options_, view()));
    if (!image.ok()) return image;
    if (verifies_view() && view()->view.to_scene) {
      const std::span<const std::byte> values = image->pixels.span();
      own_values_.assign(values.begin(), values.end());
    }
    enter_scene(view(), *image);
    if (options_.scene_light) image->light = PictureLight::kScene;
    return image;
  }

  bool is_piped() const { return job_.input == "-"; }
  const BakedView* view() const { return run_.view().get(); }
  bool verifies_view() const { return options_.verify.verify && view() != nullptr; }

  absl::StatusOr<Image> read() {
    events_.begins("reading " + job_.input);
    if (const auto limits = run_.limits(); !limits.ok()) return limits.status();
    const absl::Time begin = absl::Now();
    absl::StatusOr<Image> image = read_input();
    read_ms_ = ms_since(begin);
    if (!image.ok()) return image;
    picture_.add_notes(std::exchange(image->notes, {}));
    picture_.add_note(cube_map_note(*image));
    return image;
  }

  // Frees the frame, and stops the built-in server after the only image, before it returns, so that only the
  // picture stays in memory.
  absl::StatusOr<Image> render(Image frame) {
    events_.begins("rendering " + job_.input);
    RETURN_IF_ERROR(run_.connect());
    const absl::Time begin = absl::Now();
    FrameView view = view_of(frame);
    if (options_.previous.exposure() > 0) view.previous = options_.previous;
    view.exposure = run_.locked();
    view.verify = options_.verify.verify;
    view.error_map = !options_.verify.error_map.empty();
    // The picture will need the memory. What came through a pipe cannot be read again.
    if (only_ && !verifies_view() && !is_piped() && !options_.gain_map_target)
      view.on_sent = [&frame] { frame.pixels = {}; };
    const bool gain_map = options_.settings.has_gain_map_peak_nits() || options_.gain_map_target;
    RETURN_IF_ERROR(check_light_for_gain_map(job_.input, frame.light, gain_map));
    PictureSettings made = settings_for(frame, options_.settings,
                                        {.exposure = run_.locked(),
                                         .adapts = options_.previous.exposure() > 0,
                                         .defaults = options_.defaults,
                                         .names_primaries = options_.names_primaries});
    picture_.add_note(not_metered_note(frame, options_.settings, made.defaults));
    picture_.show(made);
    v1::Settings& settings = made.settings;
    if (options_.ignore_empty_alpha) picture_.add_note(ignore_empty_alpha(frame, settings));
    if (options_.desqueeze) picture_.add_note(desqueeze(frame, settings));
    const bool alpha = frame.has_alpha && keeps_alpha(settings);
    if (run_.view()) show_by(*run_.view(), settings);
    absl::StatusOr<RenderResult> result = call(settings, frame, view, begin + kRenderTimeout);
    const double call_ms = ms_since(begin);
    if (!result.ok()) return name_file(in_options(result.status(), options_.settings), job_.input);
    Image hdr;
    const absl::Time hdr_begin = absl::Now();
    if (options_.gain_map_target) {
      view.exposure = result->header.exposure();
      view.previous.reset();
      ASSIGN_OR_RETURN(hdr, render_hdr(settings, frame, view, begin + kRenderTimeout));
      frame.pixels = {};
    }
    if (only_) run_.close();

    const v1::ImageSize size{frame.width, frame.height};
    const double aspect = image_pixel_aspect(size, frame.pixel_aspect, settings.output_size());
    picture_.take(*result, settings, size);
    if (verifies_view()) {
      const std::span<const std::byte> own = own_values_.empty() ? view.pixels : own_values_;
      ASSIGN_OR_RETURN(const ViewError error,
                       error_of_view(run_.view()->view, {view.format, own, size, std::move(settings),
                                                         result->header, result->pixels()}));
      picture_.report().view_error = error;
      frame.pixels = {};
    }
    add_stages(call_ms, result->header);
    Image picture = picture_of(*std::move(result), alpha, aspect);
    if (options_.gain_map_target) {
      ASSIGN_OR_RETURN(GainMapCodes map, gain_map_between(picture, hdr, options_.gain_map_target->curve,
                                                          options_.gain_map_target->peak_nits));
      picture_.set_gain_map(std::move(map));
      picture_.add_stage("hdr", ms_since(hdr_begin));
    }
    picture.frame_rate = frame.frame_rate;
    picture.kept = frame.kept;
    return picture;
  }

  // The HDR picture of the same frame, for a gain map. `view` has the SDR picture's exposure.
  absl::StatusOr<Image> render_hdr(const v1::Settings& sdr, Image& frame, FrameView view,
                                   absl::Time deadline) {
    view.verify = view.error_map = false;
    const v1::Settings settings =
        hdr_settings(sdr, options_.gain_map_target->curve, options_.gain_map_target->peak_nits);
    absl::StatusOr<RenderResult> result = call(settings, frame, view, deadline);
    if (!result.ok()) return name_file(in_options(result.status(), options_.settings), job_.input);
    return picture_of(*std::move(result), false, 1);
  }

  absl::StatusOr<RenderResult> call(const v1::Settings& settings, Image& frame, FrameView& view,
                                    absl::Time deadline) {
    absl::StatusOr<RenderResult> result;
    RETURN_IF_ERROR(run_.link().call(deadline, [&](const Connection& server) {
      RETURN_IF_ERROR(read_again(frame, view));
      result = call_once(server, settings, view, deadline);
      return result.status();
    }));
    return result;
  }

  // Several images at once may be too many for the server's memory. Then this one waits for another one's
  // call to end.
  absl::StatusOr<RenderResult> call_once(const Connection& server, const v1::Settings& settings,
                                         const FrameView& view, absl::Time deadline) {
    while (true) {
      run_.begin_call();
      absl::StatusOr<RenderResult> result = server.render(settings, view, deadline);
      run_.end_call();
      if (only_ || !absl::IsUnavailable(result.status()) || !run_.wait_for_a_call()) return result;
    }
  }

  // The call that sent the frame was lost, and the frame was freed by then.
  absl::Status read_again(Image& frame, FrameView& view) {
    if (!frame.pixels.empty()) return absl::OkStatus();
    absl::StatusOr<Image> image = read_input();
    if (!image.ok()) return image.status();
    if (image->width != frame.width || image->height != frame.height || image->format != frame.format) {
      return failure_of(FailureKind::kInput, absl::FailedPreconditionError(absl::StrFormat(
                                                 "%s: it was replaced by another image while it was "
                                                 "rendered; render it again",
                                                 job_.input)));
    }
    frame.pixels = std::move(image->pixels);
    view.pixels = frame.pixels.span();
    return absl::OkStatus();
  }

  void add_stages(double call_ms, const v1::ResultHeader& header) {
    if (run_.start_ms() > 0) picture_.add_stage("start", run_.start_ms());
    if (view() != nullptr) picture_.add_stage("view", run_.bake_ms());
    picture_.add_stage("read", read_ms_);
    add_server_stages(header, call_ms, picture_.report().stage_ms);
  }

  const RenderOptions& options_;
  const RenderJob& job_;
  const bool only_;
  Run& run_;
  RunEvents& events_;
  PictureRun picture_;
  std::vector<std::byte> own_values_;  // the file's, if they are not what is sent and the view is verified
  double read_ms_ = 0;
};

}  // namespace

absl::StatusOr<RenderReport> run_frame(const RenderOptions& options, const RenderJob& job, bool only,
                                       Run& run, RunEvents& events) {
  return FrameRun(options, job, only, run, events).run();
}

}  // namespace candela
