#include "client/run/exposure/shot_exposures.h"

#include <utility>

#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "client/image/write/atomic_file.h"
#include "client/run/output_files.h"
#include "server/base/status_macros.h"

namespace candela {

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
