#include "server/render/settings/gain_curve_of.h"

#include <array>
#include <functional>

#include "server/render/color/aces.h"
#include "server/render/color/aces2.h"
#include "server/render/settings/hdr_display.h"
#include "shaders/reference.h"

namespace candela {
namespace {

using reference::Rgb;

// The settings' curve, from exposed light to display light.
std::function<Rgb(const Rgb&)> tone_curve_of(const v1::Settings& settings,
                                             const std::shared_ptr<const ColorTable>& table) {
  switch (settings.curve()) {
    case v1::TONE_CURVE_TABLE:
      return [table](const Rgb& c) { return reference::look_up(*table, c); };
    case v1::TONE_CURVE_ACES_2:
      return [](const Rgb& c) { return aces_2(c); };
    case v1::TONE_CURVE_ACES_1:
      return [](const Rgb& c) -> Rgb {
        std::array<float, 3> rgb = {static_cast<float>(c[0]), static_cast<float>(c[1]),
                                    static_cast<float>(c[2])};
        if (!aces_1(rgb).ok()) return {};
        return {rgb[0], rgb[1], rgb[2]};
      };
    default:
      return [curve = static_cast<uint32_t>(settings.curve()), white = curve_white(settings)](const Rgb& c) {
        return reference::tone_curve(curve, c, white);
      };
  }
}

}  // namespace

std::shared_ptr<const GainCurve> gain_curve_of(const v1::Settings& settings,
                                               const std::shared_ptr<const ColorTable>& table) {
  if (!settings.has_gain_map_peak_nits()) return nullptr;
  const double source_nits = settings.has_source_peak_nits() ? settings.source_peak_nits() : kPqPeakNits;
  return std::make_shared<const GainCurve>(tone_curve_of(settings, table), source_nits,
                                           settings.gain_map_peak_nits());
}

}  // namespace candela
