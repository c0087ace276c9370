#include "server/render/reference/reference_executor.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <optional>
#include <utility>

#include "server/render/reference/reference_frame.h"

namespace candela {
namespace {

template <typename T>
void store(const Buffer& buffer, size_t index, T value) {
  std::memcpy(buffer.mapped() + index * sizeof value, &value, sizeof value);
}

// Component k of texel (x, y), in the format of the output.
void store_output(const FrameTextures& textures, const ReferenceFrame& frame, double value, uint32_t x,
                  uint32_t y, size_t k) {
  const TextureLayout& layout = textures.layout;
  const Buffer& output = textures.host_output();
  const size_t index = (size_t{y} * layout.image_pitch + x) * 4 + k;
  const double largest = largest_code(static_cast<uint32_t>(layout.output_format));
  if (largest == 0.0) {
    store(output, index, imath_float_to_half(static_cast<float>(value)));
    return;
  }
  const double code =
      std::round(k < 3 ? frame.code(value, largest, x, y, k) : std::clamp(value, 0.0, 1.0) * largest);
  if (layout.output_format == v1::OUTPUT_FORMAT_RGBA8) {
    store(output, index, static_cast<uint8_t>(code));
  } else {
    store(output, index, static_cast<uint16_t>(code));
  }
}

void render_span(const FrameTextures& textures, const ReferenceFrame& frame, const RowSpan& span) {
  const auto row = frame.row(span);
  for (uint32_t x = span.first; x < span.last; ++x) {
    for (size_t k = 0; k < 4; ++k) {
      const double value = row[x - span.first][k];
      if (textures.exact) {
        const size_t index = (size_t{span.y} * textures.layout.image_pitch + x) * 4 + k;
        store(textures.host_exact(), index, static_cast<float>(value));
      }
      store_output(textures, frame, value, x, span.y, k);
    }
  }
}

}  // namespace

absl::StatusOr<Metered> ReferenceExecutor::run_meter(FrameMemory& memory, const IngestPlan& plan) {
  absl::StatusOr<Metered> metered = device_.meter(memory, plan);
  if (!metered.ok()) return metered;
  FrameTextures& textures = memory.textures();
  {
    const HostStage stage(kReferenceStage, &metered->stages);
    textures.metered_scene = meter_scene(textures, plan.matrix, plan.reference, reference::Rounding::kNone);
  }
  const reference::Meter& meter = textures.metered_scene->meter;
  metered->stats.mean_log2_luminance = meter.mean_log2_luminance;
  metered->stats.metered_weight = meter.weight;
  metered->stats.min_luminance = static_cast<float>(meter.min_luminance);
  metered->stats.max_luminance = static_cast<float>(meter.max_luminance);
  return metered;
}

absl::StatusOr<Drawn> ReferenceExecutor::run_draw(FrameMemory& memory, const Plan& plan,
                                                  std::vector<StageTime>* stages) {
  const HostStage stage(kReferenceStage, stages);
  FrameTextures& textures = memory.textures();
  std::optional<MeteredScene> scene = std::exchange(textures.metered_scene, std::nullopt);
  if (!scene) {  // the device metered the frame
    scene = meter_scene(textures, plan.reference.matrix, plan.reference.meter, reference::Rounding::kNone);
  }
  const ReferenceFrame frame(*std::move(scene), plan, kWholeBloom);
  const uint32_t height = frame.height();
  for_row_parts(frame.width(), height, row_parts(height),
                [&](const RowSpan& span, uint32_t) { render_span(textures, frame, span); });
  Drawn drawn;
  if (plan.resolve.inputs.constants.wide != 0) drawn.gamut_cut_components = frame.cut_components();
  if (plan.reference.resolve.display != shader::DISPLAY_REC709) drawn.shown = frame.shown_light();
  return drawn;
}

}  // namespace candela
