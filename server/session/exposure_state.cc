#include "server/session/exposure_state.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/limits.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

absl::Status check_picture(const v1::SessionState& state) {
  const int cells = static_cast<int>(ScenePrint().size());
  if (state.picture_size() != 0 && state.picture_size() != cells) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "open.state.picture has %d cells; it must have %d, or none", state.picture_size(), cells));
  }
  for (const float cell : state.picture()) {
    // A cell with nothing metered is NaN.
    if (std::isnan(cell) || (cell >= v1::kPictureEv.min && cell <= v1::kPictureEv.max)) continue;
    return absl::InvalidArgumentError(
        absl::StrFormat("open.state.picture has a cell of %g; a cell must be between %g and %g EV, or NaN",
                        cell, v1::kPictureEv.min, v1::kPictureEv.max));
  }
  return absl::OkStatus();
}

}  // namespace

v1::SessionState state_of(const ExposurePoint& point) {
  v1::SessionState state;
  state.set_sequence(point.sequence);
  state.set_media_time_ns(point.media_time_ns);
  state.set_exposure(point.exposed.exposure);
  state.set_target(point.exposed.target);
  state.set_cut_pending(point.cut_pending);
  if (point.print) state.mutable_picture()->Assign(point.print->begin(), point.print->end());
  return state;
}

absl::StatusOr<ExposurePoint> point_from(const v1::SessionState& state) {
  RETURN_IF_ERROR(check_factor("open.state.exposure", state.exposure()));
  RETURN_IF_ERROR(check_factor("open.state.target", state.target()));
  if (state.media_time_ns() < v1::kMediaTimeNs.min || state.media_time_ns() > v1::kMediaTimeNs.max) {
    return absl::InvalidArgumentError(
        absl::StrFormat("open.state.media_time_ns is %d; it must be between %d and %d", state.media_time_ns(),
                        v1::kMediaTimeNs.min, v1::kMediaTimeNs.max));
  }
  RETURN_IF_ERROR(check_picture(state));
  ExposurePoint point{.begun = true,
                      .sequence = state.sequence(),
                      .media_time_ns = state.media_time_ns(),
                      .exposed = {state.exposure(), state.target()},
                      .before = state.exposure(),
                      .cut_pending = state.cut_pending(),
                      .print = std::nullopt};
  if (state.picture_size() > 0) {
    std::copy(state.picture().begin(), state.picture().end(), point.print.emplace().begin());
  }
  return point;
}

}  // namespace candela
