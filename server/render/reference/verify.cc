#include "server/render/reference/verify.h"

#include <cmath>
#include <utility>

#include "server/render/reference/compare.h"
#include "server/render/reference/reference_frame.h"

namespace candela {

namespace {

FrameStats stats_of(const MeteredScene& metered) {
  FrameStats stats;
  stats.mean_log2_luminance = metered.meter.mean_log2_luminance;
  stats.min_luminance = static_cast<float>(metered.meter.min_luminance);
  stats.max_luminance = static_cast<float>(metered.meter.max_luminance);
  stats.nan_components = metered.bad.nan;
  stats.infinite_components = metered.bad.infinite;
  stats.clamped_components = metered.bad.clamped;
  stats.negative_components = metered.bad.negative;
  stats.negative_scene_components = metered.bad.negative_scene;
  stats.absent_pixels = metered.meter.absent;
  return stats;
}

// `whole`, if not null, receives the reference's statistics and counts.
Verification compare_with(reference::Rounding rounding, const FrameTextures& textures, const Plan& plan,
                          const FrameStats& stats, uint32_t level_size, uint16_t* map,
                          FrameVerification* whole) {
  const TextureLayout& layout = textures.layout;
  const ReferencePlan& p = plan.reference;
  ReferenceFrame reference(meter_scene(textures, p.matrix, p.meter, rounding), plan, level_size);
  const bool wide = plan.resolve.inputs.constants.wide != 0;
  if ((wide || p.unrounded) && rounding == reference::Rounding::kHalf) reference.unround(textures, plan);
  const Picture image = {textures.host_output().mapped(), layout.image_pitch,
                         static_cast<uint32_t>(layout.output_format)};
  const Picture codes =
      textures.exact ? Picture{textures.host_exact().mapped(), layout.image_pitch, shader::OUTPUT_FLOAT}
                     : image;
  const MeteredScene& metered = reference.metered();
  Verification v = compare(reference, codes, image, map);
  v.meter_error_ev = std::abs(stats.mean_log2_luminance - metered.meter.mean_log2_luminance);
  if (textures.exact && !layout.by_reference) {
    v.bloom_error = bloom_error(reference, textures, plan.bloom());
  }
  if (whole != nullptr) {
    whole->truth = stats_of(metered);
    whole->gamut_cut_components = wide ? reference.cut_components() : 0;
  }
  return v;
}

}  // namespace

FrameVerification verify_frame(FrameMemory& memory, const Plan& plan, const FrameStats& stats,
                               uint32_t bloom_level_size) {
  using reference::Rounding;
  const FrameTextures& textures = memory.textures();
  const TextureLayout& layout = textures.layout;
  auto* map =
      textures.error_map ? reinterpret_cast<uint16_t*>(textures.error_map.buffer().mapped()) : nullptr;
  FrameVerification verification;
  verification.rounded = compare_with(layout.by_reference ? Rounding::kNone : Rounding::kHalf, textures, plan,
                                      stats, bloom_level_size, map, &verification);
  // If there is no matrix, the scenes of other formats are already halves.
  const bool rounds = !layout.by_reference &&
                      (layout.desc.format == v1::PIXEL_FORMAT_RGBA32F || plan.reference.matrix.has_value());
  verification.unrounded =
      rounds ? compare_with(Rounding::kNone, textures, plan, stats, bloom_level_size, nullptr, nullptr)
             : verification.rounded;
  return verification;
}

}  // namespace candela
