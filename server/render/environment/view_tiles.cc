#include "server/render/environment/view_tiles.h"

#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>
#include <vector>

#include "server/render/color/portable_math.h"
#include "server/render/frame/frame_textures.h"
#include "server/render/host/view.h"
#include "server/render/plan/texture_layout.h"

namespace candela {
namespace {

double length_of(const Vector3& v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

// The rays of a rectangle of pixels, in camera axes: the middle's, and how far from it they end where z is
// -1.
struct Rays {
  Vector3 middle;
  double reach;
};

Rays rays_of(const shader::ViewParams& params, uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1) {
  const double p = params.pixel;
  return {{((x0 + x1) / 2.0 - params.width / 2.0) * p, (params.height / 2.0 - (y0 + y1) / 2.0) * p, -1.0},
          std::hypot(x1 - x0, y1 - y0) / 2 * p};
}

// Whether level 0 is all that the rays read of the sky.
bool is_magnified(const shader::ViewParams& params, const Rays& rays) {
  const Vector3& d = rays.middle;
  const std::array<double, 3> turned = {params.m00 * d[0] + params.m01 * d[1] + params.m02 * d[2],
                                        params.m10 * d[0] + params.m11 * d[1] + params.m12 * d[2],
                                        params.m20 * d[0] + params.m21 * d[1] + params.m22 * d[2]};
  const double largest = std::max({std::abs(turned[0]), std::abs(turned[1]), std::abs(turned[2])});
  // Another ray's largest component is smaller by at most their distance. A ray is at least 1 long.
  const double least = std::max(largest - rays.reach, 1 / std::numbers::sqrt3);
  constexpr double kMargin = 0.01;  // for the shader's float arithmetic
  return params.lod - 1.5 * std::log2(least) + kMargin <= 0;
}

std::vector<SphereCone> sphere_cones(const View& view) {
  std::vector<SphereCone> cones;
  for (const ViewSphere& sphere : view.objects) {
    const Vector3 o = centre_to_camera(view.camera, sphere);
    const double distance = std::hypot(o[0], o[1], o[2]);
    const double sine = std::min(1.0, sphere.radius / distance);
    cones.push_back(
        {{-o[0] / distance, -o[1] / distance, -o[2] / distance}, sine, std::sqrt(1 - sine * sine)});
  }
  return cones;
}

// The cone around the rays. It compares cosines, since there may be a million pairs of tiles and spheres.
struct TileCone {
  explicit TileCone(const Rays& rays) : middle(rays.middle), length(length_of(rays.middle)) {
    constexpr double kMargin = 1e-3;  // far more than the roundings of the shader's rays
    sine = rays.reach / length + kMargin;
    cosine = std::sqrt(std::max(0.0, 1 - sine * sine));
  }
  bool touches(const SphereCone& sphere) const {
    if (sine >= 1) return true;  // its rays are on both sides of any plane
    const double along = middle[0] * sphere.axis[0] + middle[1] * sphere.axis[1] + middle[2] * sphere.axis[2];
    return along >= length * (cosine * sphere.cosine - sine * sphere.sine);
  }
  Vector3 middle;
  double length, sine, cosine;
};

void add(std::vector<ViewRun>& row, const ViewKind& kind, uint32_t x) {
  if (!row.empty() && row.back().x1 == x && row.back().kind == kind) {
    ++row.back().x1;
  } else {
    row.push_back({kind, x, x + 1});
  }
}

}  // namespace

Constants constants_of(const ViewKind& kind, const View& view, bool floats) {
  return {kind.objects, kind.magnified, kind.sharp, kind.rough, kind.objects && view.samples > 1, floats};
}

ViewTiles::ViewTiles(const View& view, const shader::ViewParams& params,
                     std::span<const shader::ViewObject> objects)
    : params_(params), objects_(objects), cones_(sphere_cones(view)) {}

uint32_t ViewTiles::rows() const { return groups(params_.height, shader::VIEW_TILE); }

std::vector<ViewRun> ViewTiles::row(uint32_t y) const {
  constexpr uint32_t kTile = shader::VIEW_TILE;
  std::vector<ViewRun> row;
  for (uint32_t x = 0; x < groups(params_.pitch, shader::VIEW_SKY_X); ++x) {
    const uint32_t left = x * shader::VIEW_SKY_X;
    const Rays rays = rays_of(params_, left, y * kTile, std::min(left + shader::VIEW_SKY_X, params_.pitch),
                              (y + 1) * kTile);
    add(row, {.magnified = is_magnified(params_, rays)}, x);
  }
  for (uint32_t x = 0; !cones_.empty() && x < groups(params_.width, kTile); ++x) {
    const ViewKind kind = kind_of_tile(x, y);
    if (kind.objects) add(row, kind, x);
  }
  return row;
}

ViewKind ViewTiles::kind_of_tile(uint32_t x, uint32_t y) const {
  constexpr uint32_t kTile = shader::VIEW_TILE;
  const TileCone tile(rays_of(params_, x * kTile, y * kTile, (x + 1) * kTile, (y + 1) * kTile));
  ViewKind kind;
  for (uint32_t k = 0; k < cones_.size(); ++k) {
    if (!tile.touches(cones_[k])) continue;
    if (!kind.objects) kind.first_object = k;
    kind.objects = true;
    kind.end_object = k + 1;
  }
  for (uint32_t k = kind.first_object; k < kind.end_object; ++k) {
    // Some rays of a pixel with samples may see the sky, which is the chain.
    kind.sharp = kind.sharp || params_.samples_side > 1 || objects_[k].chain_weight > 0;
    kind.rough = kind.rough || objects_[k].near_weight > 0 || objects_[k].far_weight > 0;
  }
  return kind;
}

std::map<ViewKind, std::vector<Box>> boxes_of(std::span<const std::vector<ViewRun>> rows, uint32_t first) {
  std::map<ViewKind, std::vector<Box>> all;
  for (uint32_t i = 0; i < rows.size(); ++i) {
    const uint32_t y = first + i;
    for (const ViewRun& run : rows[i]) {
      std::vector<Box>& boxes = all[run.kind];
      const auto above = std::find_if(boxes.rbegin(), boxes.rend(), [&](const Box& box) {
        return box.y1 == y && box.x0 == run.x0 && box.x1 == run.x1;
      });
      if (above != boxes.rend()) {
        ++above->y1;
      } else {
        boxes.push_back({run.x0, y, run.x1, y + 1});
      }
    }
  }
  return all;
}

double cost_of(const std::vector<ViewRun>& row, const View& view) {
  constexpr double kBetween = 1.7;  // of a sky between levels
  constexpr double kObjects = 5.0;  // of a tile with objects; each takes more
  constexpr double kObject = 0.4;
  double cost = 0;
  for (const ViewRun& run : row) {
    const double each = run.kind.objects
                            ? view.samples *
                                  (kObjects + kObject * (run.kind.end_object - run.kind.first_object)) *
                                  shader::VIEW_TILE
                            : (run.kind.magnified ? 1.0 : kBetween) * shader::VIEW_SKY_X;
    cost += each * (run.x1 - run.x0) * shader::VIEW_TILE;
  }
  return cost;
}

double most_cost_of_row(const View& view, uint32_t width) {
  std::vector<ViewRun> row = {{{}, 0, groups(width, shader::VIEW_SKY_X)}};
  const auto objects = static_cast<uint32_t>(view.objects.size());
  if (objects > 0)
    row.push_back({{.objects = true, .end_object = objects}, 0, groups(width, shader::VIEW_TILE)});
  return cost_of(row, view);
}

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

namespace {

const float* texels_of(const CubeLevels& levels) {
  return levels ? reinterpret_cast<const float*>(levels.texels.buffer().mapped()) : nullptr;
}

std::vector<host::ViewPart> parts_of(const std::vector<ViewRun>& runs) {
  std::vector<host::ViewPart> parts;
  for (const ViewRun& run : runs) {
    const uint32_t columns = run.kind.objects ? shader::VIEW_TILE : shader::VIEW_SKY_X;
    parts.push_back({run.x0 * columns, run.x1 * columns, run.kind.objects, run.kind.magnified,
                     run.kind.first_object, run.kind.end_object});
  }
  return parts;
}

}  // namespace

void draw_on_host(const BakedCube& cube, bool floats, const View& view, const shader::ViewLight& light,
                  std::span<const shader::ViewObject> objects, FrameMemory& memory, Crew& crew) {
  const TextureLayout& layout = memory.textures().layout;
  const host::ViewJob job = {
      .params = view_params(view, layout.desc.width, layout.desc.height, layout.pitch, cube.chain.size),
      .chain = texels_of(cube.chain),
      .specular = texels_of(cube.specular),
      .light = light,
      .objects = objects,
      .pixels = memory.textures().input.buffer().mapped(),
      .floats = floats};
  const ViewTiles tiles(view, job.params, objects);
  const auto draw_row = [&](uint32_t y) {
    const uint32_t y0 = y * shader::VIEW_TILE;
    host::draw_view_rows(job, parts_of(tiles.row(y)), y0,
                         std::min(y0 + shader::VIEW_TILE, layout.desc.height));
  };
  crew.run(tiles.rows(), draw_row);
}

}  // namespace candela
