// A session's exposure as clients keep it: the SessionState of render.proto.
#pragma once

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/session/exposure_track.h"

namespace candela {

// The state after a frame. `point` has begun.
v1::SessionState state_of(const ExposurePoint& point);

// The point that a new session continues after. A client may claim any state, so every value is checked:
// INVALID_ARGUMENT with the field, its value and its range.
absl::StatusOr<ExposurePoint> point_from(const v1::SessionState& state);

}  // namespace candela
