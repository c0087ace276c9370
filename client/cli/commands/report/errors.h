// The errors of a report: hard cases, images and curves against the reference. Each function returns the part
// of report.json that it names; docs/report/format.md describes the rows.
#pragma once

#include <string>
#include <vector>

#include "client/cli/commands/report/scenes.h"
#include "client/cli/commands/report/session.h"

namespace candela {

// An image to compare with the reference.
struct ReportImage {
  std::string name;
  Image image;
  std::string note;  // how the image was changed, "" if it was not
};

// `hard_cases`.
absl::StatusOr<Json> measure_hard_cases(const ReportSession& session);

// `images`. Writes the pictures and error maps into `folder`.
absl::StatusOr<Json> measure_images(const ReportSession& session, const std::vector<ReportImage>& images,
                                    const std::string& folder);

// The file of an error map in that folder; images are counted from 1.
std::string error_map_name(size_t image, const std::string& tier);

// `curves`: every curve of the server on a small sample scene at bounded_tier(), and those of HDR displays in
// PQ and HLG.
absl::StatusOr<Json> measure_curves(const ReportSession& session);

// Measures how far the ACES approximations (the fits, and the
// tables of the cheaper tiers) are from the whole transform.

// Returns `aces` of docs/report/format.md.
absl::StatusOr<Json> compare_aces(const ReportSession& session, const std::vector<ReportImage>& images);

// The bounds of a report: each stage's largest error against the bound that docs/pipeline.md promises.
// docs/report/format.md describes the rows.

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

// The kinds of files: what each costs to write and read, and what it loses. docs/report/format.md describes
// the rows.

// Rows of `files`, of one image at bounded_tier(). Writes into `folder` and removes what it wrote.
absl::StatusOr<Json> measure_files(const ReportSession& session, const ReportImage& image,
                                   const std::string& folder);

}  // namespace candela
