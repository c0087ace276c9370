// Twin of what every pass of an environment knows about panoramas: directions, solid angles, lookups. The
// texels that panorama.comp stores have their twin in ingest().
#include <cmath>

#include "shaders/environment/environment.h"

namespace candela::reference {

namespace {

// Row y at column x, with texels at whole numbers: linear, and the last column joins the first one. A row
// beyond a pole is the pole's row on the other side of the sphere.
Rgb row_at(const Scene& panorama, double x, int64_t y) {
  const int64_t width = panorama.width;
  if (y < 0 || y >= int64_t{panorama.height}) x += static_cast<double>(width) / 2.0;
  const double left = std::floor(x);
  const int64_t column = (static_cast<int64_t>(left) % width + width) % width;
  Rgb out{};
  accumulate(&out, panorama.at(column, y), 1.0 - (x - left));
  accumulate(&out, panorama.at((column + 1) % width, y), x - left);
  return out;
}

}  // namespace

Direction panorama_direction(double u, double v) {
  const double lon = 2.0 * kPi * (u - 0.5);
  const double lat = kPi * (0.5 - v);
  return {std::sin(lon) * std::cos(lat), std::sin(lat), -std::cos(lon) * std::cos(lat)};
}

std::array<double, 2> panorama_uv(const Direction& d) {
  // atan2(0, -0) is pi, so the poles need their own case.
  const double lon = d[0] == 0.0 && d[2] == 0.0 ? 0.0 : std::atan2(d[0], -d[2]);
  const double lat = std::atan2(d[1], std::hypot(d[0], d[2]));
  return {lon / (2.0 * kPi) + 0.5, 0.5 - lat / kPi};
}

double panorama_solid_angle(const Scene& panorama, uint32_t y) {
  const double lat_top = kPi * (0.5 - static_cast<double>(y) / panorama.height);
  const double lat_bottom = kPi * (0.5 - (y + 1.0) / panorama.height);
  return 2.0 * kPi / panorama.width * (std::sin(lat_top) - std::sin(lat_bottom));
}

Rgb panorama_at(const Scene& panorama, double u, double v) {
  const double x = u * panorama.width - 0.5;
  const double y = v * panorama.height - 0.5;
  const double above = std::floor(y);
  const auto row = static_cast<int64_t>(above);
  Rgb out{};
  accumulate(&out, row_at(panorama, x, row), 1.0 - (y - above));
  accumulate(&out, row_at(panorama, x, row + 1), y - above);
  return out;
}

Rgb panorama_at(const Scene& panorama, const Direction& d) {
  const auto [u, v] = panorama_uv(d);
  return panorama_at(panorama, u, v);
}

Direction turned_back(const Direction& d, double rotation_deg) {
  // By minus the angle about +Y: the right-hand rule takes +Z to +X.
  const double angle = -rotation_deg * kPi / 180.0;
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  return {c * d[0] + s * d[2], d[1], -s * d[0] + c * d[2]};
}

}  // namespace candela::reference
