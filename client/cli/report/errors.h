// The accuracy half of a report: hard cases, images, and each stage's error against its bound.
#pragma once

#include <string>
#include <vector>

#include "client/cli/report/scenes.h"
#include "client/cli/report/session.h"

namespace candela {

// An image to hold against the reference.
struct ReportImage {
  std::string name;
  Image image;
  std::string note;  // "" or what was done to it
};

// A row a case and tier: case, expected (the stated result), width, height, tier and either error (why it
// failed) or finite, max_error_codes, p999_error_codes, differing_components, meter_error_ev, bloom_error,
// exposure, nan, inf, negative, picture {min, max, mean} (8-bit codes of R, G and B) and note (what else came
// out, "" for nothing); of the moving highlight flicker, too, (max - min) / mean of its light.
absl::StatusOr<Json> measure_hard_cases(const ReportSession& session);

// A row an image: name, width, height, note, picture (PNG, base64) and maps, a row a tier: tier and either
// error or max_error_codes, p999_error_codes, mean_error_codes, differing_components, meter_error_ev,
// bloom_error, png (base64). `folder` takes a file for a moment.
absl::StatusOr<Json> measure_images(const ReportSession& session, const std::vector<ReportImage>& images,
                                    const std::string& folder);

// A row a curve of the server, on a small sample scene at bounded_tier(): as the rows of hard cases.
absl::StatusOr<Json> measure_curves(const ReportSession& session);

// The row of ingest for the stages below: every half, as linear light in and out, against what the pipeline's
// rules make of it.
absl::StatusOr<Json> measure_ingest(const ReportSession& session);

// What the bounds are held against, at bounded_tier().
struct Measured {
  const Json& hard_cases;
  const Json& curves;
  const Json& images;
};

// A row a stage: stage, unit, bound, measured, where (the frame that was worst), ok.
Json judge_stages(const ReportSession& session, const Measured& measured);

}  // namespace candela
