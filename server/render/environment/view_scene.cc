#include "server/render/environment/view_scene.h"

#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "server/render/color/portable_math.h"

namespace candela {

namespace {

static_assert(sizeof(shader::ViewLight) % 16 == 0 && sizeof(shader::ViewObject) % 16 == 0);

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

// The table at this roughness. A number stands beside the next column's, so that the shader reads four at
// once.
void set_brdf(double roughness, std::span<const uint16_t> brdf, shader::ViewObject& object) {
  constexpr uint32_t kEnd = shader::BRDF_SIZE - 1;
  const double y = std::clamp(roughness * shader::BRDF_SIZE - 0.5, 0.0, double{kEnd});
  const auto top = static_cast<uint32_t>(y);
  const auto at = [&](uint32_t column, uint32_t row, uint32_t k) -> double {
    const uint32_t index = std::min(row, kEnd) * shader::BRDF_SIZE + std::min(column, kEnd);
    return imath_half_to_float(brdf[2 * index + k]);
  };
  for (uint32_t i = 0; i < 4 * shader::BRDF_SIZE; ++i) {
    const uint32_t column = i / 4 + i / 2 % 2;
    object.brdf[i] =
        static_cast<float>(std::lerp(at(column, top, i % 2), at(column, top + 1, i % 2), y - top));
  }
}

shader::ViewObject view_object(const ViewCamera& camera, const ViewSphere& sphere, const CubeLevels& specular,
                               std::span<const uint16_t> brdf) {
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
  set_levels(sphere.roughness, specular, out);
  set_brdf(sphere.roughness, brdf, out);
  return out;
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
  params.lod = static_cast<float>(portable_log2(p * chain_size / 2));
  params.chain_size = chain_size;
  params.chain_last = chain_levels(chain_size) - 1;
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

std::vector<shader::ViewObject> view_objects(const View& view, const CubeLevels& specular,
                                             std::span<const uint16_t> brdf) {
  std::vector<shader::ViewObject> objects;
  objects.reserve(view.objects.size());
  for (const ViewSphere& sphere : view.objects) {
    objects.push_back(view_object(view.camera, sphere, specular, brdf));
  }
  return objects;
}

shader::ViewLight view_light(const Harmonics& irradiance) {
  shader::ViewLight light{};
  for (size_t i = 0; i < irradiance.size(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      light.irradiance[4 * i + k] = static_cast<float>(irradiance[i][k] * kHarmonicFactors[i]);
    }
  }
  return light;
}

std::vector<std::byte> view_scene(const shader::ViewLight& light,
                                  std::span<const shader::ViewObject> objects) {
  std::vector<std::byte> bytes(sizeof light + objects.size_bytes());
  std::memcpy(bytes.data(), &light, sizeof light);
  if (!objects.empty()) std::memcpy(bytes.data() + sizeof light, objects.data(), objects.size_bytes());
  return bytes;
}

}  // namespace candela
