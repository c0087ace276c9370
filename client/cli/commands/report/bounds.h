// The bounds of a report: each stage's largest error against the bound that docs/pipeline.md promises.
// docs/report/format.md describes the rows.
#pragma once

#include "client/cli/commands/report/session.h"

namespace candela {

// The first row of `stage_errors`: renders every half as linear
// light and compares it with the rules of the pipeline.
absl::StatusOr<Json> measure_ingest(const ReportSession& session);

// The measurements that are compared with the bounds, at bounded_tier().
struct Measured {
  const Json& hard_cases;
  const Json& curves;
  const Json& images;
};

// The other rows of `stage_errors`.
Json judge_stages(const ReportSession& session, const Measured& measured);

}  // namespace candela
