#include "server/render/color/hdr_signal.h"

#include <algorithm>

#include "server/render/color/portable_math.h"

namespace candela {

double pq_signal(double light) {
  const double y = portable_power(light, 2610.0 / 16384);
  return portable_power((3424.0 / 4096 + 2413.0 / 128 * y) / (1 + 2392.0 / 128 * y), 2523.0 / 32);
}

double pq_light(double signal) {
  const double p = portable_power(signal, 32.0 / 2523);
  const double y = std::max(p - 3424.0 / 4096, 0.0) / (2413.0 / 128 - 2392.0 / 128 * p);
  return portable_power(y, 16384.0 / 2610);
}

double hlg_exponent(double peak_nits) {
  const double gamma = 1.2 + 0.42 * portable_log2(peak_nits / 1000) / portable_log2(10);
  return (1 - gamma) / gamma;
}

}  // namespace candela
