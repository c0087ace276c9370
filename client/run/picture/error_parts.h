// The error of an image, part by part (docs/pipeline.md section 6).
#pragma once

#include <optional>

#include "candela/v1/render.pb.h"

namespace candela {

// The largest error that each part can add, in 1/255 of the display range.
struct ErrorParts {
  double rendering = 0.0;         // of the tier, before dither and rounding
  bool proven = false;            // `rendering` is the frame's bound, else it was measured in this frame
  std::optional<double> table{};  // of a view: its table, as it was measured when it was made
  double dither = 0.0;
  double rounding = 0.0;         // to the image's codes
  std::optional<double> file{};  // of a JPEG or AVIF file, measured by reading it again
  bool lacks_file = false;       // it is on standard output, which cannot be read again

  // The sum of the known parts.
  double sum() const { return rendering + table.value_or(0) + dither + rounding + file.value_or(0); }
};

// Those of a result without `table` and `file`. Absent if the result was neither verified nor rendered with
// max_error_codes. If both, the measured error counts.
std::optional<ErrorParts> error_parts(const v1::ResultHeader& header, const v1::Settings& settings);

}  // namespace candela
