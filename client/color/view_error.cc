#include "client/color/view_error.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "server/base/status_macros.h"
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

using Show = std::function<void(std::span<float>)>;

// How the frame was drawn, with the view instead of a curve.
reference::ResolveParams resolve_params(const Show& show, const ViewedFrame& frame, const v1::Bloom& bloom) {
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

std::array<float, 4> own_values(const ViewedFrame& frame, size_t at) {
  std::array<float, 4> pixel;
  if (frame.format == v1::PIXEL_FORMAT_RGBA32F) {
    std::memcpy(pixel.data(), frame.pixels.data() + at * sizeof pixel, sizeof pixel);
  } else {
    std::array<uint16_t, 4> bits;
    std::memcpy(bits.data(), frame.pixels.data() + at * sizeof bits, sizeof bits);
    for (size_t k = 0; k < 4; ++k) pixel[k] = imath_half_to_float(bits[k]);
  }
  constexpr float kInfinity = 65504.0f;
  for (float& v : pixel) {
    if (std::isnan(v)) v = 0.0f;
    if (std::isinf(v)) v = std::copysign(kInfinity, v);
  }
  return pixel;
}

// The file's values, changed by `to_scene` unless it is null, and then by the matrix.
reference::Scene scene_of(const ViewedFrame& frame, const Show& to_scene,
                          const std::optional<std::array<float, 9>>& matrix) {
  reference::Scene scene{frame.size.width, frame.size.height, {}, {}};
  scene.texels.resize(size_t{scene.width} * scene.height);
  for (size_t at = 0; at < scene.texels.size(); ++at) {
    std::array<float, 4> pixel = own_values(frame, at);
    if (to_scene) to_scene(std::span(pixel).first(3));
    if (matrix) {
      const std::array<float, 4> own = pixel;
      for (size_t r = 0; r < 3; ++r) {
        double sum = 0.0;
        for (size_t c = 0; c < 3; ++c) sum += double{(*matrix)[3 * r + c]} * own[c];
        pixel[r] = static_cast<float>(sum);
      }
    }
    scene.texels[at] = pixel;
  }
  return scene;
}

}  // namespace

absl::StatusOr<ViewError> error_of_view(const ViewTable& view, const ViewedFrame& frame) {
  v1::Settings settings = frame.settings;
  RETURN_IF_ERROR(v1::complete_settings(settings));
  ASSIGN_OR_RETURN(const auto matrix, scene_matrix(settings));
  const uint32_t width = frame.header.width();
  const uint32_t height = frame.header.height();
  const v1::Bloom& bloom = settings.bloom();
  reference::ResolveParams params = resolve_params(view.show, frame, bloom);
  const bool resized = v1::ImageSize{width, height} != frame.size;
  const bool untouched = params.exposure == 1.0 && params.bloom == shader::BLOOM_NONE && !matrix && !resized;
  const bool direct = untouched && view.show_input;
  if (direct) params = resolve_params(view.show_input, frame, bloom);
  reference::Scene scene = scene_of(frame, direct ? nullptr : view.to_scene, matrix);
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
  if (resized) {
    scene = reference::resize(scene, level, levels, params, width, height);
    params.bloom = shader::BLOOM_NONE;
  }
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
