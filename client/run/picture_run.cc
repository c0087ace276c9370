#include "client/run/picture_run.h"

#include <iterator>
#include <utility>

#include "client/image/encodings.h"
#include "client/run/picture/error_map.h"
#include "client/run/picture/file_error.h"
#include "client/run/picture/frame_files.h"
#include "client/run/picture/frame_notes.h"
#include "client/run/picture/picture_size.h"
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
  report_.metered = options.settings.exposure().mode() != v1::Exposure::MODE_MANUAL && !run.locked();
  report_.notes = options.notes;
  report_.curve = curve_word(options.settings);
  report_.defaults = options.defaults;
  if (run.view() == nullptr) return;
  report_.view = run.view()->report;
  report_.curve = report_.view->view;
  add_notes(run.view()->notes);
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
  if (run_.shows_light()) add_note(gamut_note(report_.header, settings).value_or(""));
}

absl::Status PictureRun::write(const Image& picture) {
  events_.begins("writing " + report_.output);
  const absl::Time begin = absl::Now();
  WriteOptions options = write_options_for(options_.write, report_.header);
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

}  // namespace candela
