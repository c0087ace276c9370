// The size of the image that is made of a frame.
#pragma once

#include <cstdint>

#include "absl/status/status.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/limits.h"
#include "server/render/settings/frame.h"

namespace candela {

using v1::ImageSize;

// INVALID_ARGUMENT if a field is out of its range, or given with another one that it does not go with.
absl::Status check_output_size(const v1::OutputSize& size);

// The image's size for a frame, docs/pipeline.md section 5; the frame's own without `output_size`. The
// settings have passed check_output_size. A side of more than UINT32_MAX is UINT32_MAX. Pure.
ImageSize image_size(const v1::Settings& settings, const FrameDesc& desc);

bool resizes(const v1::Settings& settings, const FrameDesc& desc);

}  // namespace candela
