#include "client/run/picture/error_parts.h"

namespace candela {
namespace {

// A step between two codes where they are farthest apart, in 1/255 of the display range: of RGBA16F that of
// halves from 0.5 to 1.
double step_of(v1::OutputFormat format) {
  switch (format) {
    case v1::OUTPUT_FORMAT_RGBA16:
      return 255.0 / 65535;
    case v1::OUTPUT_FORMAT_RGBA16F:
      return 255.0 / 2048;
    default:
      return 1.0;
  }
}

}  // namespace

std::optional<ErrorParts> error_parts(const v1::ResultHeader& header, const v1::Settings& settings) {
  if (!header.has_verify() && !header.has_error_bound_codes()) return std::nullopt;
  const double step = step_of(header.format());
  const bool dithers = settings.dither() && header.format() != v1::OUTPUT_FORMAT_RGBA16F;
  return ErrorParts{.rendering = header.has_verify() ? header.verify_unrounded().max_error_codes()
                                                     : header.error_bound_codes(),
                    .proven = !header.has_verify(),
                    .dither = dithers ? step : 0.0,
                    .rounding = step / 2};
}

}  // namespace candela
