#include "client/run/picture/frame_alpha.h"

#include <half.h>

#include <cmath>
#include <cstring>

namespace candela {
namespace {

float to_float(float component) { return component; }
float to_float(uint16_t component) { return imath_half_to_float(component); }

// Whether alpha is 0 or less everywhere although there is light. NaN counts as 0, as in ingest.
template <typename Component>
bool alpha_is_empty(const Image& frame) {
  bool light = false;
  Component texel[4];
  for (uint64_t at = 0; at < frame.bytes(); at += sizeof texel) {
    std::memcpy(texel, frame.pixels.data() + at, sizeof texel);
    if (to_float(texel[3]) > 0.0f) return false;
    for (int k = 0; k < 3 && !light; ++k) light = std::abs(to_float(texel[k])) > 0.0f;
  }
  return light;
}

}  // namespace

std::string ignore_empty_alpha(const Image& frame, v1::Settings& settings) {
  if (!frame.has_alpha) return "";
  const bool floats = frame.format == ImageFormat::kRgba32f;
  if (!(floats ? alpha_is_empty<float>(frame) : alpha_is_empty<uint16_t>(frame))) return "";
  settings.set_alpha(v1::ALPHA_IGNORE);
  return "alpha ignored: it is 0 everywhere and would hide the whole picture; --alpha straight uses it";
}

}  // namespace candela
