#include "server/render/environment/view_tiles.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

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

}  // namespace candela
