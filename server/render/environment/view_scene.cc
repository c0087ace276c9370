#include "server/render/environment/view_scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/render/plan/texture_layout.h"

namespace candela {

namespace {

double length_of(const Vector3& v) { return std::hypot(v[0], v[1], v[2]); }

// p, the side of a pixel at distance 1.
double pixel_side(const View& view, uint32_t height) {
  return 2 * std::tan(view.camera.fov_deg * std::numbers::pi / 360) / height;
}

// Weights and places of the levels that E_r lies between.
void set_levels(double roughness, const CubeLevels& specular, shader::ViewObject& object) {
  object.chain_weight = 1.0f;
  object.near_size = object.far_size = 1;
  if (!specular) return;
  const double level = roughness * (2 - roughness) * specular.levels;
  const auto whole = std::min(static_cast<uint32_t>(level), specular.levels);
  const auto part = static_cast<float>(level - whole);
  const uint32_t near = std::max(whole, 1u) - 1;  // in `specular`, which has no level 0
  const uint32_t far = std::min(whole, specular.levels - 1);
  object.chain_weight = whole == 0 ? 1.0f - part : 0.0f;
  object.near_weight = whole == 0 ? 0.0f : 1.0f - part;
  object.far_weight = part;
  object.near_size = specular.size_of(near);
  object.near_start = static_cast<uint32_t>(specular.start(near));
  object.far_size = specular.size_of(far);
  object.far_start = static_cast<uint32_t>(specular.start(far));
}

shader::ViewObject view_object(const ViewCamera& camera, const ViewSphere& sphere,
                               const CubeLevels& specular) {
  shader::ViewObject out{};
  const Vector3 o = centre_to_camera(camera, sphere);
  const double r2 = sphere.radius * sphere.radius;
  out.ox = static_cast<float>(o[0]);
  out.oy = static_cast<float>(o[1]);
  out.oz = static_cast<float>(o[2]);
  out.radius_squared = static_cast<float>(r2);
  out.to_surface = static_cast<float>(o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - r2);
  out.inverse_radius = static_cast<float>(1 / sphere.radius);
  const auto f0 = [&](size_t k) {
    return static_cast<float>(0.04 + (sphere.base_color[k] - 0.04) * sphere.metallic);
  };
  const auto diffuse = [&](size_t k) {
    return static_cast<float>((1 - sphere.metallic) * sphere.base_color[k] / std::numbers::pi);
  };
  out.f0_r = f0(0), out.f0_g = f0(1), out.f0_b = f0(2);
  out.diffuse_r = diffuse(0), out.diffuse_g = diffuse(1), out.diffuse_b = diffuse(2);
  out.roughness = static_cast<float>(sphere.roughness);
  set_levels(sphere.roughness, specular, out);
  return out;
}

// A cone of directions in camera axes.
struct Cone {
  Vector3 axis;  // of length 1
  double angle;  // between the axis and the edge
};

double angle_between(const Vector3& a, const Vector3& b) {
  const Vector3 cross = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
  return std::atan2(length_of(cross), a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
}

std::vector<Cone> sphere_cones(const View& view) {
  std::vector<Cone> cones;
  for (const ViewSphere& sphere : view.objects) {
    const Vector3 o = centre_to_camera(view.camera, sphere);
    const double distance = length_of(o);
    cones.push_back({{-o[0] / distance, -o[1] / distance, -o[2] / distance},
                     std::asin(std::min(1.0, sphere.radius / distance))});
  }
  return cones;
}

// The cone around all rays of a tile. Its corners are the farthest from its middle.
Cone tile_cone(uint32_t tile_x, uint32_t tile_y, uint32_t width, uint32_t height, double p) {
  const double left = tile_x * shader::VIEW_TILE_X - width / 2.0, right = left + shader::VIEW_TILE_X;
  const double top = height / 2.0 - tile_y * shader::VIEW_TILE_Y, bottom = top - shader::VIEW_TILE_Y;
  const auto ray = [&](double x, double y) {
    const double length = std::hypot(x * p, y * p, 1.0);
    return Vector3{x * p / length, y * p / length, -1 / length};
  };
  Cone cone{ray((left + right) / 2, (top + bottom) / 2), 0};
  for (double x : {left, right}) {
    for (double y : {top, bottom}) cone.angle = std::max(cone.angle, angle_between(cone.axis, ray(x, y)));
  }
  return cone;
}

bool touches(const Cone& tile, const std::vector<Cone>& spheres) {
  constexpr double kMargin = 1e-3;  // far more than the roundings of the shader's rays
  return std::any_of(spheres.begin(), spheres.end(), [&](const Cone& sphere) {
    return angle_between(tile.axis, sphere.axis) <= tile.angle + sphere.angle + kMargin;
  });
}

}  // namespace

shader::ViewParams view_params(const View& view, uint32_t width, uint32_t height, uint32_t pitch,
                               uint32_t chain_size) {
  shader::ViewParams params{};
  const double p = pixel_side(view, height);
  params.width = width;
  params.height = height;
  params.pitch = pitch;
  params.samples_side = view.samples == 16 ? 4 : view.samples == 4 ? 2 : 1;
  params.pixel = static_cast<float>(p);
  params.lod = static_cast<float>(std::log2(p * chain_size / 2));
  params.chain_size = chain_size;
  params.chain_last = chain_levels(chain_size) - 1;
  params.objects = static_cast<uint32_t>(view.objects.size());
  const double turn = -view.rotation_deg * std::numbers::pi / 180;
  const Matrix3& m = view.camera.rotation;
  std::array<float, 9> t;
  for (size_t k = 0; k < 3; ++k) {
    t[k] = static_cast<float>(std::cos(turn) * m[k] + std::sin(turn) * m[6 + k]);
    t[3 + k] = static_cast<float>(m[3 + k]);
    t[6 + k] = static_cast<float>(-std::sin(turn) * m[k] + std::cos(turn) * m[6 + k]);
  }
  params.m00 = t[0], params.m01 = t[1], params.m02 = t[2];
  params.m10 = t[3], params.m11 = t[4], params.m12 = t[5];
  params.m20 = t[6], params.m21 = t[7], params.m22 = t[8];
  return params;
}

bool is_magnified(const shader::ViewParams& params) {
  // Of lod, c / m is at most the square root of 3. The margin is for the shader's float arithmetic.
  constexpr double kMargin = 0.01;
  return params.lod + 1.5 * std::log2(std::numbers::sqrt3) + kMargin <= 0;
}

shader::ViewScene view_scene(const View& view, const Harmonics& irradiance, const CubeLevels& specular) {
  shader::ViewScene scene{};
  for (size_t i = 0; i < irradiance.size(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      scene.irradiance[3 * i + k] = static_cast<float>(irradiance[i][k] * kHarmonicFactors[i]);
    }
  }
  for (size_t i = 0; i < view.objects.size(); ++i) {
    scene.objects[i] = view_object(view.camera, view.objects[i], specular);
  }
  return scene;
}

std::vector<TileRow> tile_rows(const View& view, uint32_t width, uint32_t height, uint32_t pitch) {
  const double p = pixel_side(view, height);
  const std::vector<Cone> spheres = sphere_cones(view);
  const uint32_t columns = groups(pitch, shader::VIEW_TILE_X);
  std::vector<TileRow> rows(groups(height, shader::VIEW_TILE_Y));
  for (uint32_t y = 0; y < rows.size(); ++y) {
    TileRow& row = rows[y];
    for (uint32_t x = 0; x < columns; ++x) {
      const bool object = !spheres.empty() && touches(tile_cone(x, y, width, height, p), spheres);
      ++(object ? row.object_tiles : row.sky_tiles);
      std::vector<Box>& runs = object ? row.with_objects : row.sky;
      if (!runs.empty() && runs.back().x1 == x) {
        ++runs.back().x1;
      } else {
        runs.push_back({x, y, x + 1, y + 1});
      }
    }
  }
  return rows;
}

}  // namespace candela
