// What calls with frames tell the metrics alike.
#pragma once

#include <optional>

#include "absl/status/status.h"
#include "server/base/metrics.h"
#include "server/schedule/frame_queue.h"

namespace candela {

// The stages of a frame that was rendered, its wait in the queue among them.
void count_stages(Metrics& metrics, const RenderedFrame& rendered);

// What turned a call away that had no frame yet; nothing where the client left or fell silent.
std::optional<Rejection> rejection_of(const absl::Status& status);

}  // namespace candela
