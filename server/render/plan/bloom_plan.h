// The bloom's part of a frame's plan.
#pragma once

#include "server/render/plan/lit_area.h"
#include "server/render/plan/plan.h"

namespace candela {

// The shader inputs that all passes share that read the frame.
shader::InputParams input_params(const TextureLayout& layout, const std::optional<reference::Matrix>& matrix);

// Scene luminance above which there is bloom: the settings' threshold, or kGaussian's multiple of the mean.
float bright_threshold(const v1::Bloom& bloom, const FrameStats& stats);
// True if the frame blooms. Also true if it would bloom with a metered mean that is lower by `mean_error` EV:
// the reference's may be.
bool may_bloom(const v1::Bloom& bloom, const FrameStats& stats, const FrameDesc& desc, double mean_error);

void plan_bloom(const TextureLayout& layout, const Metered& metered, const v1::Bloom& bloom,
                const std::optional<reference::Matrix>& matrix, Plan& plan);

// The frame's texels that the finished bloom reaches.
Area bloom_reach(const TextureLayout& layout, const Plan& plan);

}  // namespace candela
