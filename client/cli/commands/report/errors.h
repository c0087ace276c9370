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

}  // namespace candela
