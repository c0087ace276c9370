// The bloom's part of a frame's plan.
#pragma once

#include "server/render/plan/lit_area.h"
#include "server/render/plan/plan.h"

namespace candela {

// The shader inputs that all passes share that read the frame.
shader::InputParams input_params(const TextureLayout& layout, const std::optional<reference::Matrix>& matrix);

// Scene luminance above which there is bloom: the settings' threshold, or kGaussian's multiple of the mean.
float bright_threshold(const v1::Bloom& bloom, const FrameStats& stats);
// Whether the frame blooms, or would if its metered mean were lower by `mean_error` EV, as the reference's
// may be.
bool may_bloom(const v1::Bloom& bloom, const FrameStats& stats, const FrameDesc& desc, double mean_error);

// The parts of the frame with light that may pass the bright pass.
Area bright_area(const v1::Bloom& bloom, const FrameStats& stats, const FrameDesc& desc);

void plan_bloom(const TextureLayout& layout, const Metered& metered, const v1::Bloom& bloom,
                const std::optional<reference::Matrix>& matrix, Plan& plan);

// The frame's texels that the finished bloom reaches.
Area bloom_reach(const TextureLayout& layout, const Plan& plan);

}  // namespace candela
