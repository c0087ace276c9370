#include "server/schedule/frame_metrics.h"

namespace candela {

void count_stages(Metrics& metrics, const RenderedFrame& rendered) {
  metrics.stage("queue", rendered.queued);
  for (const StageTime& stage : rendered.report.stages)
    metrics.stage(stage.name, absl::Nanoseconds(stage.ns));
}

std::optional<Rejection> rejection_of(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kAlreadyExists:
      return Rejection::kRequest;
    case absl::StatusCode::kResourceExhausted:
      return Rejection::kSize;
    case absl::StatusCode::kUnavailable:
      return Rejection::kMemory;
    default:
      return std::nullopt;
  }
}

std::optional<Rejection> rejection_at_open(const absl::Status& status) {
  if (absl::IsFailedPrecondition(status)) return Rejection::kToken;
  if (absl::IsUnavailable(status)) return Rejection::kDraining;
  return rejection_of(status);
}

}  // namespace candela
