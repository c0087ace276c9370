// Twin of panorama_sh.comp: the panorama in real spherical harmonics, and the irradiance from them.
#include <algorithm>
#include <cmath>

#include "shaders/environment/environment.h"

namespace candela::reference {

namespace {

// The factors of Y_lm: of 1; of x, y and z; of xy, yz and xz; of 3 z^2 - 1; of x^2 - y^2.
const double kOne = std::sqrt(1.0 / (4.0 * kPi));
const double kLinear = std::sqrt(3.0 / (4.0 * kPi));
const double kProduct = std::sqrt(15.0 / (4.0 * kPi));
const double kAxis = std::sqrt(5.0 / (16.0 * kPi));
const double kSquares = std::sqrt(15.0 / (16.0 * kPi));

std::array<double, 9> harmonics_of(const Direction& d) {
  const auto [x, y, z] = d;
  return {kOne,
          kLinear * y,
          kLinear * z,
          kLinear * x,
          kProduct * x * y,
          kProduct * y * z,
          kAxis * (3.0 * z * z - 1.0),
          kProduct * x * z,
          kSquares * (x * x - y * y)};
}

// Integrals over a row's latitudes of the products below, S = sin lat and C = cos lat. One C of each is the
// area's.
struct RowIntegrals {
  double c;    // C
  double sc;   // S C
  double cc;   // C C
  double scc;  // S C C
  double ccc;  // C C C
  double ssc;  // S S C
};

RowIntegrals antiderivatives_in_lat(double lat) {
  const double s = std::sin(lat);
  const double c = std::cos(lat);
  return {s, s * s / 2.0, (lat + s * c) / 2.0, -c * c * c / 3.0, s - s * s * s / 3.0, s * s * s / 3.0};
}

RowIntegrals row_integrals(uint32_t y, uint32_t height) {
  const RowIntegrals top = antiderivatives_in_lat(kPi * (0.5 - static_cast<double>(y) / height));
  const RowIntegrals bottom = antiderivatives_in_lat(kPi * (0.5 - (y + 1.0) / height));
  return {top.c - bottom.c,     top.sc - bottom.sc,   top.cc - bottom.cc,
          top.scc - bottom.scc, top.ccc - bottom.ccc, top.ssc - bottom.ssc};
}

// Integrals over a column's longitudes, S = sin lon and C = cos lon.
struct ColumnIntegrals {
  double one;
  double s;
  double c;
  double ss;
  double cc;
  double sc;
};

ColumnIntegrals antiderivatives_in_lon(double lon) {
  const double s = std::sin(lon);
  const double c = std::cos(lon);
  return {lon, -c, s, (lon - s * c) / 2.0, (lon + s * c) / 2.0, s * s / 2.0};
}

ColumnIntegrals column_integrals(uint32_t x, uint32_t width) {
  const ColumnIntegrals left = antiderivatives_in_lon(2.0 * kPi * (static_cast<double>(x) / width - 0.5));
  const ColumnIntegrals right = antiderivatives_in_lon(2.0 * kPi * ((x + 1.0) / width - 0.5));
  return {right.one - left.one, right.s - left.s,   right.c - left.c,
          right.ss - left.ss,   right.cc - left.cc, right.sc - left.sc};
}

// The integrals of Y_lm over a texel, whose direction is (sin lon C, S, -cos lon C).
std::array<double, 9> texel_integrals(const RowIntegrals& row, const ColumnIntegrals& column) {
  return {kOne * row.c * column.one,
          kLinear * row.sc * column.one,
          -kLinear * row.cc * column.c,
          kLinear * row.cc * column.s,
          kProduct * row.scc * column.s,
          -kProduct * row.scc * column.c,
          kAxis * (3.0 * row.ccc * column.cc - row.c * column.one),
          -kProduct * row.ccc * column.sc,
          kSquares * (row.ccc * column.ss - row.ssc * column.one)};
}

}  // namespace

Harmonics panorama_sh(const Scene& panorama) {
  std::vector<ColumnIntegrals> columns;
  for (uint32_t x = 0; x < panorama.width; ++x) columns.push_back(column_integrals(x, panorama.width));
  Harmonics out{};
  for (uint32_t y = 0; y < panorama.height; ++y) {
    const RowIntegrals row = row_integrals(y, panorama.height);
    Harmonics row_sum{};
    for (uint32_t x = 0; x < panorama.width; ++x) {
      const std::array<double, 9> integrals = texel_integrals(row, columns[x]);
      for (size_t lm = 0; lm < 9; ++lm) accumulate(&row_sum[lm], panorama.at(x, y), integrals[lm]);
    }
    for (size_t lm = 0; lm < 9; ++lm) accumulate(&out[lm], row_sum[lm], 1.0);
    row_done();
  }
  return out;
}

Harmonics turned(const Harmonics& radiance, double rotation_deg) {
  // The turned environment is a polynomial of degree 2 in the direction, too. Band 1 is w.d with a vector w,
  // band 2 is d.(M d) with a symmetric matrix M. Both turn like a direction: w' = R w and M' = R M R^T.
  const auto turn = [&](const Direction& v) { return turned_back(v, -rotation_deg); };
  Harmonics out{};
  out[0] = radiance[0];
  for (size_t n = 0; n < 3; ++n) {
    const auto l = [&](size_t lm) { return radiance[lm][n]; };
    const Direction w = turn({l(3), l(1), l(2)});
    out[3][n] = w[0];
    out[1][n] = w[1];
    out[2][n] = w[2];
    const double xy = kProduct / 2.0 * l(4);
    const double yz = kProduct / 2.0 * l(5);
    const double xz = kProduct / 2.0 * l(7);
    const double xx = kSquares * l(8) - kAxis * l(6);
    const double yy = -kSquares * l(8) - kAxis * l(6);
    const double zz = 2.0 * kAxis * l(6);
    // M is symmetric. So turning its rows gives M R^T, and turning the columns of that gives R M R^T.
    const Direction rows[3] = {turn({xx, xy, xz}), turn({xy, yy, yz}), turn({xz, yz, zz})};
    Direction columns[3];
    for (size_t k = 0; k < 3; ++k) columns[k] = turn({rows[0][k], rows[1][k], rows[2][k]});
    out[4][n] = columns[1][0] * 2.0 / kProduct;
    out[5][n] = columns[2][1] * 2.0 / kProduct;
    out[6][n] = columns[2][2] / (2.0 * kAxis);
    out[7][n] = columns[2][0] * 2.0 / kProduct;
    out[8][n] = (columns[0][0] - columns[1][1]) / (2.0 * kSquares);
  }
  return out;
}

Harmonics irradiance_of(const Harmonics& radiance) {
  Harmonics out{};
  for (size_t lm = 0; lm < 9; ++lm) {
    const double a = lm == 0 ? kPi : lm < 4 ? 2.0 * kPi / 3.0 : kPi / 4.0;
    accumulate(&out[lm], radiance[lm], a);
  }
  return out;
}

Rgb irradiance_at(const Harmonics& irradiance, const Direction& n) {
  const std::array<double, 9> y = harmonics_of(n);
  Rgb sum{};
  for (size_t lm = 0; lm < 9; ++lm) accumulate(&sum, irradiance[lm], y[lm]);
  for (double& c : sum) c = std::max(0.0, c);
  return sum;
}

}  // namespace candela::reference
