// Settings for tests, and messages of them from the values that tests have.
#pragma once

#include <cstdint>

#include "client/image/image.h"
#include "server/render/color/primaries.h"
#include "server/render/settings/settings.h"
#include "shaders/color_table.h"

namespace candela::testing {

// Complete settings from a message that is known to be good; ends the program if it is refused.
inline Settings checked(const v1::Settings& message) { return Settings::from(message).value(); }

inline v1::Settings at_ev(double ev) {
  v1::Settings message;
  message.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  message.mutable_exposure()->set_manual_ev(ev);
  return message;
}

// Exposure 1 and no bloom, so that the scene's light is the exposed light.
inline v1::Settings plain() {
  v1::Settings message;
  message.mutable_exposure()->set_mode(v1::Exposure::MODE_MANUAL);
  message.mutable_bloom()->set_intensity(0);
  return message;
}

inline v1::Chromaticities to_message(const Chromaticities& chromaticities) {
  const std::array<double, 8>& xy = chromaticities.xy;
  v1::Chromaticities message;
  message.set_red_x(static_cast<float>(xy[0]));
  message.set_red_y(static_cast<float>(xy[1]));
  message.set_green_x(static_cast<float>(xy[2]));
  message.set_green_y(static_cast<float>(xy[3]));
  message.set_blue_x(static_cast<float>(xy[4]));
  message.set_blue_y(static_cast<float>(xy[5]));
  message.set_white_x(static_cast<float>(xy[6]));
  message.set_white_y(static_cast<float>(xy[7]));
  return message;
}

// That say what an image says of its light.
inline v1::Settings settings_of(const Image& image) {
  v1::Settings settings;
  if (image.chromaticities) {
    Chromaticities chromaticities;
    std::copy(image.chromaticities->begin(), image.chromaticities->end(), chromaticities.xy.begin());
    *settings.mutable_input_chromaticities() = to_message(chromaticities);
  }
  return settings;
}

inline v1::ColorTable to_message(const ColorTable& table) {
  v1::ColorTable message;
  message.set_size(table.size);
  message.set_axes(static_cast<v1::ColorTable::Axes>(table.axes));
  message.set_end(table.end);
  message.set_values(table.values.data(), table.values.size() * sizeof table.values[0]);
  return message;
}

// Pixels with x0 <= x < x1 and y0 <= y < y1.
inline v1::Rectangle rectangle(uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1) {
  v1::Rectangle message;
  message.set_x0(x0);
  message.set_y0(y0);
  message.set_x1(x1);
  message.set_y1(y1);
  return message;
}

inline v1::Bloom bloom(v1::Bloom::Kind kind, float intensity, float threshold, float softness,
                       uint32_t levels, bool firefly_weights) {
  v1::Bloom message;
  message.set_kind(kind);
  message.set_intensity(intensity);
  message.set_threshold(threshold);
  message.set_softness(softness);
  message.set_levels(levels);
  message.set_firefly_weights(firefly_weights);
  return message;
}

inline constexpr v1::Metering::Statistic kStatistics[] = {v1::Metering::STATISTIC_LOG_AVERAGE,
                                                          v1::Metering::STATISTIC_PERCENTILE};
inline constexpr v1::Metering::Weights kWeights[] = {
    v1::Metering::WEIGHTS_AVERAGE, v1::Metering::WEIGHTS_CENTER, v1::Metering::WEIGHTS_SPOT};

// Without bloom. With WEIGHTS_SPOT, the spot is the rectangle that ends at (40, 5000).
inline v1::Settings metering_settings(v1::Metering::Statistic statistic, v1::Metering::Weights weights,
                                      float ignore_below = 0) {
  v1::Settings message;
  v1::Metering& metering = *message.mutable_exposure()->mutable_metering();
  metering.set_statistic(statistic);
  metering.set_weights(weights);
  metering.set_ignore_below(ignore_below);
  metering.mutable_spot()->set_x1(40);
  metering.mutable_spot()->set_y1(5000);
  message.mutable_bloom()->set_intensity(0);
  return message;
}

inline v1::Adaptation adaptation(v1::Adaptation::Domain domain, double speed_up, double speed_down) {
  v1::Adaptation message;
  message.set_domain(domain);
  message.set_speed_up(speed_up);
  message.set_speed_down(speed_down);
  return message;
}

}  // namespace candela::testing
