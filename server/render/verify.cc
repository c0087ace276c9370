#include "server/render/verify.h"

#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "server/render/primaries.h"

namespace candela {

namespace {

constexpr double kCodes = 255.0;

double steps(OutputFormat format) { return format == OutputFormat::kRgba8 ? 255.0 : 65535.0; }

// Component k of a texel as a display value.
double component(const std::byte* texel, OutputFormat format, size_t k) {
  if (format == OutputFormat::kRgba8) return std::to_integer<int>(texel[k]) / 255.0;
  uint16_t bits;
  std::memcpy(&bits, texel + 2 * k, sizeof bits);
  return format == OutputFormat::kRgba16 ? bits / 65535.0 : imath_half_to_float(bits);
}

}  // namespace

ReferenceFrame render_reference(const FrameDesc& desc, std::span<const std::byte> wire,
                                const Settings& settings, double exposure, uint32_t bloom_level_size) {
  std::optional<reference::Matrix> matrix;
  if (settings.input_chromaticities) {
    if (const auto m = matrix_to_rec709(*settings.input_chromaticities); m.ok()) matrix = *m;
  }
  ReferenceFrame frame;
  const reference::Scene scene = reference::ingest(wire, desc.width, desc.height,
                                                   static_cast<uint32_t>(desc.format), matrix, &frame.bad);
  const MeteringSettings& metering = settings.exposure.metering;
  frame.meter =
      reference::meter(scene, {metering.statistic == MeterStatistic::kPercentile,
                               metering.percentile_low,
                               metering.percentile_high,
                               static_cast<uint32_t>(metering.weights),
                               {metering.spot.x0, metering.spot.y0, metering.spot.x1, metering.spot.y1}});
  reference::Level bloom;
  uint32_t levels = 1;
  if (settings.bloom.intensity > 0) {
    bloom = reference::bloom(
        scene,
        {static_cast<uint32_t>(settings.bloom.kind), settings.bloom.threshold, settings.bloom.softness,
         settings.bloom.levels, settings.bloom.firefly_weights, bloom_level_size},
        frame.meter.mean_log2_luminance, &levels);
  }
  reference::ResolveParams params;
  params.exposure = std::min(exposure * settings.prescale, 0x1p46);
  if (settings.bloom.intensity > 0) params.bloom = static_cast<uint32_t>(settings.bloom.kind);
  params.level_size = settings.bloom.kind == BloomKind::kGaussian ? 4 : bloom_level_size;
  params.bloom_intensity = settings.bloom.intensity;
  params.curve = static_cast<uint32_t>(settings.curve);
  params.curve_white = settings.curve_white;
  params.transfer = static_cast<uint32_t>(settings.transfer);
  params.encode = settings.output_format != OutputFormat::kRgba16f;
  frame.image = reference::resolve(scene, bloom, levels, params);
  return frame;
}

Difference compare(const FrameMemory& memory, const Settings& settings, const ReferenceFrame& reference) {
  const FrameDesc& desc = memory.desc();
  const OutputFormat format = settings.output_format;
  Difference d;
  std::vector<float> errors;
  errors.reserve(reference.image.size() * 3);
  double sum = 0.0;
  for (uint32_t y = 0; y < desc.height; ++y) {
    const std::byte* row = memory.output_row(y).data();
    for (uint32_t x = 0; x < desc.width; ++x) {
      for (size_t k = 0; k < 3; ++k) {
        const double value = component(row + size_t{x} * bytes_per_pixel(format), format, k);
        const double truth = reference.image[size_t{y} * desc.width + x][k];
        const double codes = std::abs(value - truth) * kCodes;
        // Written so that a NaN counts as the worst.
        if (!(codes <= d.max_codes)) {
          d.max_codes = codes;
          d.worst_x = x;
          d.worst_y = y;
        }
        errors.push_back(static_cast<float>(codes));
        sum += codes;
        if (format != OutputFormat::kRgba16f) {
          const double off = std::abs(std::round(value * steps(format)) - std::round(truth * steps(format)));
          if (off != 0) ++d.differing;
          d.max_difference = std::max(d.max_difference, off);
        }
      }
    }
  }
  d.components = errors.size();
  d.mean_codes = sum / static_cast<double>(errors.size());
  const auto p999 = errors.begin() + static_cast<ptrdiff_t>(static_cast<double>(errors.size() - 1) * 0.999);
  std::nth_element(errors.begin(), p999, errors.end());
  d.p999_codes = *p999;
  return d;
}

}  // namespace candela
