#include "client/color/view_error.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "proto/candela/v1/pixel_size.h"
#include "proto/candela/v1/settings.h"
#include "server/render/color/primaries.h"
#include "shaders/reference.h"

namespace candela {
namespace {

// Component k of pixel `at` as a display value.
double component(const ViewedFrame& frame, size_t at, size_t k) {
  const std::byte* const image = frame.image.data();
  if (frame.header.format() == v1::OUTPUT_FORMAT_RGBA8)
    return std::to_integer<int>(image[4 * at + k]) / 255.0;
  uint16_t bits;
  std::memcpy(&bits, image + 2 * (4 * at + k), sizeof bits);
  return frame.header.format() == v1::OUTPUT_FORMAT_RGBA16 ? bits / 65535.0 : imath_half_to_float(bits);
}

// How the frame was drawn, with the view instead of a curve.
reference::ResolveParams resolve_params(const std::function<void(std::span<float>)>& show,
                                        const ViewedFrame& frame, const v1::Bloom& bloom) {
  reference::ResolveParams params;
  params.exposure = std::min<double>(frame.header.exposure() * frame.header.prescale(), shader::MAX_EXPOSURE);
  if (bloom.intensity() > 0) params.bloom = static_cast<uint32_t>(bloom.kind());
  params.bloom_intensity = bloom.intensity();
  if (bloom.kind() == v1::Bloom::KIND_GAUSSIAN) params.level_size = 4;
  params.transfer = shader::TRANSFER_LINEAR;  // the view's values are encoded already
  params.look = [&show](const reference::Rgb& c) -> reference::Rgb {
    std::array<float, 3> rgb = {static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2])};
    show(rgb);
    return {rgb[0], rgb[1], rgb[2]};
  };
  return params;
}

}  // namespace

absl::StatusOr<ViewError> error_of_view(const std::function<void(std::span<float>)>& show,
                                        const ViewedFrame& frame) {
  v1::Settings settings = frame.settings;
  if (absl::Status status = v1::complete_settings(settings); !status.ok()) return status;
  const auto matrix = scene_matrix(settings);
  if (!matrix.ok()) return matrix.status();
  const uint32_t width = frame.header.width();
  const uint32_t height = frame.header.height();
  reference::BadCounts bad;
  const auto ingest = [&](reference::Rounding rounding) {
    return reference::ingest(frame.pixels, size_t{width} * v1::bytes_per_pixel(frame.format), width, height,
                             static_cast<uint32_t>(frame.format), *matrix, rounding, &bad);
  };
  reference::Scene scene = ingest(reference::Rounding::kHalf);
  const v1::Bloom& bloom = settings.bloom();
  const reference::ResolveParams params = resolve_params(show, frame, bloom);
  reference::Level level;
  uint32_t levels = 1;
  if (params.bloom != shader::BLOOM_NONE) {
    level = reference::bloom(scene,
                             {.kind = params.bloom,
                              .threshold = bloom.threshold(),
                              .softness = bloom.softness(),
                              .levels = bloom.levels(),
                              .firefly_weights = bloom.firefly_weights()},
                             frame.header.statistics().mean_log2_luminance(), &levels);
  }
  if (bad.negative_scene > 0) scene = ingest(reference::Rounding::kHalfUnlessNegative);
  ViewError error;
  std::vector<float> codes;
  double sum = 0.0;
  for (uint32_t y = 0; y < height; ++y) {
    const auto row = reference::resolve_row(scene, level, levels, params, y);
    for (uint32_t x = 0; x < width; ++x) {
      if (scene.at(x, y)[3] != 1.0f) continue;
      ++error.pixels;
      for (size_t k = 0; k < 3; ++k) {
        double off = std::abs(component(frame, size_t{y} * width + x, k) - row[x][k]) * 255.0;
        if (std::isnan(off)) off = std::numeric_limits<double>::infinity();
        codes.push_back(static_cast<float>(off));
        sum += off;
        if (off <= error.max_codes) continue;
        error.max_codes = off;
        error.worst_x = x;
        error.worst_y = y;
      }
    }
  }
  if (codes.empty()) return error;
  const auto p999 = codes.begin() + static_cast<std::ptrdiff_t>((codes.size() - 1) * 999 / 1000);
  std::nth_element(codes.begin(), p999, codes.end());
  error.p999_codes = *p999;
  error.mean_codes = sum / static_cast<double>(codes.size());
  return error;
}

}  // namespace candela
