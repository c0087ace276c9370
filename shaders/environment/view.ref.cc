// Twin of view.comp: the sky and spheres through a camera.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "shaders/environment/environment.h"

namespace candela::reference {

namespace {

constexpr double kNearEdge = 1e-4;

double radians(double deg) { return deg * kPi / 180.0; }

Rotation multiply(const Rotation& a, const Rotation& b) {
  Rotation out{};
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) {
      for (size_t k = 0; k < 3; ++k) out[3 * r + c] += a[3 * r + k] * b[3 * k + c];
    }
  }
  return out;
}

Direction multiply(const Rotation& m, const Direction& d) {
  return {m[0] * d[0] + m[1] * d[1] + m[2] * d[2], m[3] * d[0] + m[4] * d[1] + m[5] * d[2],
          m[6] * d[0] + m[7] * d[1] + m[8] * d[2]};
}

struct View {
  const ViewScene& scene;
  const Camera& camera;
  uint32_t width;
  uint32_t height;

  // p: the side of a pixel at the distance 1 along the axis.
  double pixel() const { return 2.0 * std::tan(radians(camera.fov_deg) / 2.0) / height; }
};

struct Ray {
  Direction d;               // in world axes, not normalised
  double solid_angle = 0.0;  // of the pixel around it
};

// The ray through (x, y) in pixels.
Ray ray_at(const View& view, double x, double y) {
  const double p = view.pixel();
  const Direction d = {(x - view.width / 2.0) * p, (view.height / 2.0 - y) * p, -1.0};
  const double cosine = 1.0 / std::sqrt(dot(d, d));
  return {multiply(view.camera.rotation, d), p * p * cosine * cosine * cosine};
}

// The environment's level 0 in direction d, blurred over `solid_angle` by the chain.
Rgb sharp_light(const ViewScene& scene, const Direction& d, double solid_angle) {
  const Direction looked_up = normalized(turned_back(d, scene.rotation_deg));
  const double m = std::max({std::abs(looked_up[0]), std::abs(looked_up[1]), std::abs(looked_up[2])});
  const double side = 2.0 / scene.chain[0].size;
  const double lod = std::log2(solid_angle / (side * side * m * m * m)) / 2.0;
  return cube_at(scene.chain, looked_up, lod);
}

// E_r of the direction R. `solid_angle` is what level 0 is blurred over.
Rgb reflected_light(const ViewScene& scene, const Direction& r, double roughness, double solid_angle) {
  const auto last = static_cast<double>(scene.specular.size() - 1);
  const double at = roughness * (2.0 - roughness) * last;
  const double fine = std::floor(at);
  const double coarse = std::min(fine + 1.0, last);
  const auto level = [&](double index) {
    if (index == 0.0) return sharp_light(scene, r, solid_angle);
    return cube_at(scene.specular[static_cast<size_t>(index)], turned_back(r, scene.rotation_deg));
  };
  Rgb out{};
  accumulate(&out, level(fine), 1.0 - (at - fine));
  accumulate(&out, level(coarse), at - fine);
  return out;
}

// (scale, bias, 0) at a texel of the BRDF table, clamped to its edge.
struct BrdfTable {
  static constexpr int64_t kSize = 128;
  std::span<const BrdfSum> sums;

  Rgb at(int64_t x, int64_t y) const {
    const int64_t column = std::clamp<int64_t>(x, 0, kSize - 1);
    const int64_t row = std::clamp<int64_t>(y, 0, kSize - 1);
    const BrdfSum& sum = sums[static_cast<size_t>(row * kSize + column)];
    return {sum.scale, sum.bias, 0.0};
  }
};

struct Hit {
  const Sphere* sphere = nullptr;
  double at = 0.0;   // in lengths of the ray's d
  Direction centre;  // from the camera
};

// Where a ray meets a sphere, if it does. Sets *near_edge if it passes near the sphere's edge.
std::optional<Hit> meet(const View& view, const Ray& ray, const Sphere& sphere, bool* near_edge) {
  const Camera& camera = view.camera;
  const Direction centre = sphere.fixed_to_camera ? multiply(camera.rotation, sphere.centre)
                                                  : add(sphere.centre, camera.position, -1.0);
  const Direction& d = ray.d;
  const Direction o = {-centre[0], -centre[1], -centre[2]};
  const double along = dot(o, d);
  if (along >= 0.0) return std::nullopt;
  const Direction across = cross(o, d);
  const double distance = std::sqrt(dot(across, across) / dot(d, d));
  if (std::abs(distance / sphere.radius - 1.0) < kNearEdge) *near_edge = true;
  const double inside = sphere.radius * sphere.radius * dot(d, d) - dot(across, across);
  if (inside < 0.0) return std::nullopt;
  return Hit{&sphere, (-along - std::sqrt(inside)) / dot(d, d), centre};
}

Hit nearest_hit(const View& view, const Ray& ray, bool* near_edge) {
  Hit nearest;
  for (const Sphere& sphere : view.scene.objects) {
    const std::optional<Hit> hit = meet(view, ray, sphere, near_edge);
    if (hit && (nearest.sphere == nullptr || hit->at < nearest.at)) nearest = *hit;
  }
  return nearest;
}

Rgb shade(const ViewScene& scene, const Ray& ray, const Hit& hit) {
  const Sphere& sphere = *hit.sphere;
  const Direction normal = normalized({hit.at * ray.d[0] - hit.centre[0], hit.at * ray.d[1] - hit.centre[1],
                                       hit.at * ray.d[2] - hit.centre[2]});
  const Direction incoming = normalized(ray.d);  // -v
  const double nov = std::clamp(-dot(normal, incoming), 0.0, 1.0);
  const Direction r = add(incoming, normal, -2.0 * dot(normal, incoming));

  const double distance = hit.at * std::sqrt(dot(ray.d, ray.d));
  const double q = std::max(nov, 0.001);
  const double spread =
      (1.0 + 2.0 * distance * q / sphere.radius) * (1.0 + 2.0 * distance / (sphere.radius * q));
  const Rgb specular = reflected_light(scene, r, sphere.roughness, ray.solid_angle * spread);
  const Rgb irradiance = irradiance_at(scene.irradiance, turned_back(normal, scene.rotation_deg));
  const Rgb brdf = bilinear(BrdfTable{scene.brdf}, nov * BrdfTable::kSize - 0.5,
                            sphere.roughness * BrdfTable::kSize - 0.5);
  Rgb out{};
  for (size_t n = 0; n < 3; ++n) {
    const double f0 = std::lerp(0.04, sphere.base_color[n], sphere.metallic);
    const double f = f0 * brdf[0] + brdf[1];
    const double diffuse = (1.0 - sphere.metallic) * sphere.base_color[n] * irradiance[n] / kPi * (1.0 - f);
    out[n] = specular[n] * f + diffuse;
  }
  return out;
}

Rgb light_of(const View& view, const Ray& ray, const Hit& hit) {
  return hit.sphere == nullptr ? sharp_light(view.scene, ray.d, ray.solid_angle)
                               : shade(view.scene, ray, hit);
}

// The pixel (x, y), with a grid x grid rays where they do not all meet the same thing.
Rgb pixel_at(const View& view, uint32_t x, uint32_t y, uint32_t grid, bool* near_edge) {
  const Ray centre = ray_at(view, x + 0.5, y + 0.5);
  const Hit at_centre = nearest_hit(view, centre, near_edge);
  std::vector<std::pair<Ray, Hit>> rays;
  bool same = true;
  for (uint32_t k = 0; k < grid * grid; ++k) {
    const Ray ray = ray_at(view, x + (k % grid + 0.5) / grid, y + (k / grid + 0.5) / grid);
    const Hit hit = nearest_hit(view, ray, near_edge);
    same = same && hit.sphere == at_centre.sphere;
    rays.emplace_back(ray, hit);
  }
  if (same) return light_of(view, centre, at_centre);
  Rgb mean{};
  for (const auto& [ray, hit] : rays) {
    accumulate(&mean, light_of(view, ray, hit), 1.0 / static_cast<double>(rays.size()));
  }
  return mean;
}

}  // namespace

Rotation camera_rotation(double yaw_deg, double pitch_deg, double roll_deg) {
  const auto [yaw_s, yaw_c] = std::pair{std::sin(radians(-yaw_deg)), std::cos(radians(-yaw_deg))};
  const auto [pitch_s, pitch_c] = std::pair{std::sin(radians(pitch_deg)), std::cos(radians(pitch_deg))};
  const auto [roll_s, roll_c] = std::pair{std::sin(radians(-roll_deg)), std::cos(radians(-roll_deg))};
  const Rotation about_y = {yaw_c, 0, yaw_s, 0, 1, 0, -yaw_s, 0, yaw_c};
  const Rotation about_x = {1, 0, 0, 0, pitch_c, -pitch_s, 0, pitch_s, pitch_c};
  const Rotation about_z = {roll_c, -roll_s, 0, roll_s, roll_c, 0, 0, 0, 1};
  return multiply(multiply(about_y, about_x), about_z);
}

std::vector<Rgb> view_row(const ViewScene& scene, const Camera& camera, uint32_t width, uint32_t height,
                          uint32_t samples, uint32_t y, std::vector<bool>* near_edge) {
  const View view{scene, camera, width, height};
  const auto grid = static_cast<uint32_t>(std::lround(std::sqrt(samples)));
  std::vector<Rgb> row;
  row.reserve(width);
  if (near_edge != nullptr) near_edge->assign(width, false);
  for (uint32_t x = 0; x < width; ++x) {
    bool is_near_edge = false;
    row.push_back(pixel_at(view, x, y, grid, &is_near_edge));
    if (near_edge != nullptr) (*near_edge)[x] = is_near_edge;
  }
  return row;
}

}  // namespace candela::reference
