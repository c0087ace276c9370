// The largest error that a tier can make in a frame, proven from the settings and from what metering found in
// it.
//
// docs/pipeline.md section 6 derives the bounds. They hold on every device, because they count roundings of
// float32, and do not depend on any measurement.
#pragma once

#include "server/render/settings/settings.h"
#include "server/render/settings/tiers.h"
#include "shaders/params.h"

namespace candela {

// The bound of a frame that has none: no two values of a component differ by more.
inline constexpr double kNoBound = 255.0;

// What a bound depends on besides the settings.
struct BoundFacts {
  bool blooms = false;                // some light may pass the bright pass
  bool wide = false;                  // the scene has negative components
  bool translucent = false;           // some alpha is not 1
  double exposure = 0.0;              // the factor E * prescale
  double threshold = 0.0;             // of the bright pass, in scene luminance
  double largest = shader::MAX_HALF;  // no component of the scene is above
  bool resized = false;               // the image has another size than the frame
  // Of wide frames, known after they are drawn: see Drawn::negative_light.
  double negative_light = 0.0;
};

// In codes, before dither and quantising, as verification measures it; kNoBound if there is none. Pure. For a
// wide frame that is not drawn yet it is a lower limit of the bound.
double error_bound(const Tier& tier, const Settings& settings, const BoundFacts& facts);

// The largest difference, in EV, between the mean that a device meters and the mean that the reference
// meters. With percentiles, rounding may move a texel into the next bin of the histogram.
double mean_error(const v1::Metering& metering);

// The facts with the smallest and with the largest bound of all frames of this format with these settings.
BoundFacts easiest_facts();
BoundFacts hardest_facts(const FrameDesc& desc, const Settings& settings);

// The rows of tiers() that max_error_codes may take for a frame of these settings: from the first one that
// keeps it for some frame to the first one that keeps it for every frame. The reference keeps every one.
std::span<const Tier> tiers_in_question(const FrameDesc& desc, const Settings& settings);

// A line for people: why max_error_codes chose this tier, whose bound for the frame is `bound`.
std::string reason_for(const Tier& tier, double bound, const Settings& settings, const BoundFacts& facts);

}  // namespace candela
