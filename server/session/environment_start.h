// The start of a panorama, a bake and a view, checked.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"
#include "candela/v1/render.pb.h"
#include "server/render/environment/environment.h"
#include "server/render/environment/view.h"
#include "server/render/settings/settings.h"
#include "server/session/render_start.h"

namespace candela {

struct PanoramaStart {
  WireLayout layout;
  std::optional<std::array<float, 9>>
      to_scene;             // the wire's linear RGB to linear Rec.709; absent if not needed
  bool reject_bad = false;  // a NaN or an Inf refuses the panorama
};

// Checks everything that can be checked before the pixels arrive. INVALID_ARGUMENT or RESOURCE_EXHAUSTED.
absl::StatusOr<PanoramaStart> panorama_start_from(const v1::EnvironmentStart& start,
                                                  const FrameLimits& limits);

// INVALID_ARGUMENT naming the field, its value and its range.
absl::StatusOr<View> view_from(const v1::View& view);

// The quality of what views read, whatever their tier.
BakeQuality view_quality();

struct BakeStart {
  BakeSpec spec;
  v1::PixelFormat format = v1::PIXEL_FORMAT_RGBA16F;
  bool verify = false;  // measure each level's error
};
// The same for a bake. Whether the level count fits the size is known when the panorama is.
absl::StatusOr<BakeStart> bake_start_from(const v1::BakeEnvironmentRequest& request);

}  // namespace candela
