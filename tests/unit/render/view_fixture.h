// Scenes of spheres before a sky, for the tests of the reference of views.
#pragma once

#include <optional>
#include <vector>

#include "tests/unit/render/environment_support.h"

namespace candela::reference {

// A scene that owns what a ViewScene refers to. Without changes it is black.
struct Stage {
  std::vector<CubeLevel> chain = cube_chain(cube_of(16, [](const Direction&) { return Rgb{}; }));
  std::vector<CubeLevel> specular = {chain[0]};
  Harmonics irradiance{};
  std::vector<BrdfSum> brdf = std::vector<BrdfSum>(128 * 128);
  double rotation_deg = 0.0;
  std::vector<Sphere> objects;

  ViewScene scene() const { return {chain, specular, irradiance, brdf, rotation_deg, objects}; }
};

inline constexpr Rgb kRed = {1, 0, 0};
inline constexpr Rgb kGreen = {0, 1, 0};

using Picture = std::vector<std::vector<Rgb>>;

inline Picture picture_of(const Stage& stage, const Camera& camera, uint32_t width, uint32_t height,
                          uint32_t samples = 1) {
  Picture rows;
  for (uint32_t y = 0; y < height; ++y) {
    rows.push_back(view_row(stage.scene(), camera, width, height, samples, y));
  }
  return rows;
}

// What the camera sees ahead of it.
inline Rgb middle_of(const Stage& stage) { return view_row(stage.scene(), {}, 5, 5, 1, 2)[2]; }

inline double difference(const Picture& a, const Picture& b) {
  double worst = 0.0;
  for (size_t y = 0; y < a.size(); ++y) {
    for (size_t x = 0; x < a[y].size(); ++x) worst = std::max(worst, candela::difference(a[y][x], b[y][x]));
  }
  return worst;
}

// A sphere that is its base_color wherever it is seen: the irradiance is pi and it has no highlight.
inline Sphere flat(const Direction& centre, double radius, const Rgb& color) {
  return {centre, radius, color, 0, 0.5, false};
}

// For flat spheres before a black sky.
inline Stage flat_stage(std::vector<Sphere> objects) {
  Stage stage;
  for (double& c : stage.irradiance[0]) c = kPi * std::sqrt(4 * kPi);
  stage.objects = std::move(objects);
  return stage;
}

// A stage whose spheres of metallic 1 are mirrors without loss.
inline Stage mirror_stage(std::vector<Sphere> objects) {
  Stage stage;
  for (BrdfSum& sum : stage.brdf) sum = {1.0, 0.0};
  stage.objects = std::move(objects);
  return stage;
}

inline Sphere mirror(const Direction& centre, double radius, double roughness = 0.0) {
  return {centre, radius, {1, 1, 1}, 1, roughness, false};
}

// The ray through (x, y) of a camera that is not turned.
inline Direction ray(double x, double y, uint32_t width, uint32_t height, double fov_deg) {
  const double half_height = std::tan(fov_deg * kPi / 360);
  return unit({(2 * x / width - 1) * half_height * width / height, (1 - 2 * y / height) * half_height, -1});
}

// The distance at which a ray from `from` with length 1 meets a sphere.
inline std::optional<double> trace(const Direction& from, const Direction& d, const Sphere& sphere) {
  const Direction to = {sphere.centre[0] - from[0], sphere.centre[1] - from[1], sphere.centre[2] - from[2]};
  const double b = dot3(to, d);
  const double root = b * b - dot3(to, to) + sphere.radius * sphere.radius;
  if (b <= 0 || root < 0) return std::nullopt;
  return b - std::sqrt(root);
}

// Level k is k everywhere, so a picture is the level of detail.
inline std::vector<CubeLevel> lod_chain(uint32_t size) {
  std::vector<CubeLevel> chain;
  for (; size > 0; size /= 2) {
    const auto lod = static_cast<double>(chain.size());
    chain.push_back(CubeLevel{size, std::vector<Rgb>(6 * size * size, Rgb{lod, lod, lod})});
  }
  return chain;
}

// The solid angle of the rectangle (x +- side/2, y +- side/2) in the plane at the distance 1.
inline double patch(double x, double y, double side) {
  const auto corner = [](double s, double t) { return std::atan2(s * t, std::sqrt(s * s + t * t + 1)); };
  const double h = side / 2;
  return corner(x + h, y + h) - corner(x - h, y + h) - corner(x + h, y - h) + corner(x - h, y - h);
}

// The solid angle of a texel whose centre is in direction d.
inline double texel_at(const Direction& d, uint32_t size) {
  const CubeSpot spot = cube_spot(d);
  return patch(spot.s, spot.t, 2.0 / size);
}

}  // namespace candela::reference
