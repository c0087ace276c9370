// The accuracy half of a report: hard cases, images, and each stage's error against its bound.
#pragma once

#include <string>
#include <vector>

#include "client/cli/report_scenes.h"
#include "client/cli/report_session.h"

namespace candela {

// An image to hold against the reference.
struct ReportImage {
  std::string name;
  Image image;
  std::string note;  // "" or what was done to it
};

// A row a case and tier: case, width, height, tier and either error (why it failed) or finite,
// max_error_codes, p999_error_codes, differing_components, meter_error_ev, bloom_error, exposure, nan, inf,
// negative, note (what is to be seen); of the moving highlight flicker, too, (max - min) / mean of its light.
absl::StatusOr<Json> measure_hard_cases(const ReportSession& session);

// A row an image: name, width, height, note, picture (PNG, base64) and maps, a row a tier: tier and either
// error or max_error_codes, p999_error_codes, mean_error_codes, differing_components, meter_error_ev,
// bloom_error, png (base64). `folder` takes a file for a moment.
absl::StatusOr<Json> measure_images(const ReportSession& session, const std::vector<ReportImage>& images,
                                    const std::string& folder);

// A row a curve of the server, on a small sample scene at bounded_tier(): as the rows of hard cases.
absl::StatusOr<Json> measure_curves(const ReportSession& session);

// A row a stage: stage, unit, bound, measured, where (the frame that was worst), ok. Over what the three
// above measured at bounded_tier().
Json judge_stages(const ReportSession& session, const Json& hard_cases, const Json& images,
                  const Json& curves);

}  // namespace candela
