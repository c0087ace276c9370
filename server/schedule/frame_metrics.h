// Metrics that every call with frames reports.
#pragma once

#include <optional>

#include "absl/status/status.h"
#include "server/base/metrics.h"
#include "server/schedule/frame_queue.h"

namespace candela {

// Records the stages of a rendered frame, including its time in the queue.
void count_stages(Metrics& metrics, const RenderedFrame& rendered);

// The reason for which a frame was refused before it had memory. Nothing if the client left or went silent.
std::optional<Rejection> rejection_of(const absl::Status& status);

// The reason for which a session's open message was refused. Before a session is open, only its token has an
// unmet precondition, and only a draining server is unavailable.
std::optional<Rejection> rejection_at_open(const absl::Status& status);

}  // namespace candela
