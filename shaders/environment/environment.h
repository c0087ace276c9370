// The float64 reference of environments: every stage of docs/environments.md as plain loops.
//
// As with the references of a frame (shaders/reference.h), each x.comp has a twin x.ref.cc beside it, written
// from the page and not from the shader. The world is right-handed, +Y up; a direction need not have length
// 1. The functions keep no state but reference.h's row hook, so any thread may call them.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <vector>

#include "shaders/reference.h"

namespace candela::reference {

using Direction = std::array<double, 3>;  // in world axes
using Rotation = std::array<double, 9>;   // row by row, camera to world

// A cube map's level: six faces in the order +X -X +Y -Y +Z -Z, each size x size texels, row by row.
struct CubeLevel {
  uint32_t size = 0;
  std::vector<Rgb> texels;

  const Rgb& at(uint32_t face, uint32_t i, uint32_t j) const {
    return texels[(size_t{face} * size + j) * size + i];
  }
};

// --- directions (section 1)

// The unit direction that the panorama shows at (u, v), each 0 .. 1, and the way back.
Direction panorama_direction(double u, double v);
std::array<double, 2> panorama_uv(const Direction& d);
// The solid angle of a texel in row y, in steradians. All texels of the panorama sum to 4 pi.
double panorama_solid_angle(const Scene& panorama, uint32_t y);
// P(d): `panorama` at d, bilinear, without a seam. Alpha is not read.
Rgb panorama_at(const Scene& panorama, const Direction& d);
// The same at (u, v), each 0 .. 1.
Rgb panorama_at(const Scene& panorama, double u, double v);
// Turns a looked-up direction for an environment that is turned by `rotation_deg` about +Y.
Direction turned_back(const Direction& d, double rotation_deg);

// --- cube_face.comp and cube_down.comp (section 2)

// A place on a face: s and t are -1 .. 1 from edge to edge. Texel (i, j) of a level of `size` has its centre
// at s = 2 (i + 0.5) / size - 1, t = 2 (j + 0.5) / size - 1.
struct CubeSpot {
  uint32_t face = 0;
  double s = 0.0;
  double t = 0.0;
};
// The point of that place on the cube -1 .. 1, which is not normalised, and the way back for any direction
// but 0. On an edge the earlier axis wins.
Direction cube_point(const CubeSpot& spot);
CubeSpot cube_spot(const Direction& d);
// The unit direction of the centre of texel (i, j), and the texel's solid angle.
Direction cube_direction(uint32_t face, uint32_t i, uint32_t j, uint32_t size);
double cube_solid_angle(uint32_t i, uint32_t j, uint32_t size);
// N0, the default size for a panorama's width.
uint32_t cube_default_size(uint32_t panorama_width);
// Level 0: each texel is the mean of samples x samples values of P. A bake holds the world turned by
// `rotation_deg`.
CubeLevel cube_face(const Scene& panorama, uint32_t size, uint32_t samples, double rotation_deg);
// The next level, half as large. `level.size` is even.
CubeLevel cube_down(const CubeLevel& level);
// Level 0 and all levels after it, down to 1 x 1.
std::vector<CubeLevel> cube_chain(CubeLevel level);
// A seamless bilinear lookup, and one between the levels of a chain; `lod` is clamped to the chain.
Rgb cube_at(const CubeLevel& level, const Direction& d);
Rgb cube_at(std::span<const CubeLevel> chain, const Direction& d, double lod);

// --- panorama_sh.comp (section 3)

// L_lm of R, G and B, in the order of (l, m): (0,0) (1,-1) (1,0) (1,1) (2,-2) .. (2,2).
using Harmonics = std::array<Rgb, 9>;
Harmonics panorama_sh(const Scene& panorama);
// The same for the environment turned by `rotation_deg`.
Harmonics turned(const Harmonics& radiance, double rotation_deg);
// A_l L_lm.
Harmonics irradiance_of(const Harmonics& radiance);
// Irr(n) from the irradiance coefficients, for a unit direction.
Rgb irradiance_at(const Harmonics& irradiance, const Direction& n);

// --- cube_specular.comp (section 4)

enum class RoughnessMapping { kLinear, kPerceptual };
// The number of specular levels of a cube of `size`, and the roughness of each.
uint32_t specular_levels(uint32_t size);
double specular_roughness(uint32_t level, uint32_t levels, RoughnessMapping mapping);
// E_r(n) for roughness > 0, exactly: the sum over the whole panorama. Takes some milliseconds.
Rgb specular_at(const Scene& panorama, const Direction& n, double roughness);

// --- brdf_table.comp (section 5)

struct BrdfSum {
  double scale = 0.0;
  double bias = 0.0;
};
// The integral at one point, n.v and roughness in 0 .. 1 (0 excluded for n.v), within 1e-6.
BrdfSum brdf_sum(double nov, double roughness);

// --- view.comp (section 6)

struct Sphere {
  Direction centre{};
  double radius = 0.5;
  Rgb base_color{1.0, 1.0, 1.0};
  double metallic = 0.0;
  double roughness = 0.0;
  bool fixed_to_camera = false;  // `centre` is in camera axes
};

struct Camera {
  Rotation rotation{1, 0, 0, 0, 1, 0, 0, 0, 1};
  Direction position{};
  double fov_deg = 60.0;  // vertical
};
Rotation camera_rotation(double yaw_deg, double pitch_deg, double roll_deg);

// What a view looks at, baked by the device or by the twins. Nothing here is turned yet: `rotation_deg` is
// applied to each lookup.
struct ViewScene {
  std::span<const CubeLevel> chain;     // the sky, from level 0 down to 1 x 1
  std::span<const CubeLevel> specular;  // RoughnessMapping::kPerceptual; the first is level 0's size
  Harmonics irradiance{};
  // The BRDF table as 128 x 128 pairs; column n.v, row roughness.
  std::span<const BrdfSum> brdf;
  double rotation_deg = 0.0;
  std::span<const Sphere> objects;
};

// Row y of a view of width x height pixels in scene light; `samples` is 1, 4 or 16. If `near_edge` is not
// null, it is set to whether a ray of the pixel passes within 1e-4 of a sphere's radius of its edge.
std::vector<Rgb> view_row(const ViewScene& scene, const Camera& camera, uint32_t width, uint32_t height,
                          uint32_t samples, uint32_t y, std::vector<bool>* near_edge = nullptr);

// Arithmetic of directions and colours for the references of environments.

constexpr double kPi = std::numbers::pi;

inline double dot(const Direction& a, const Direction& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

inline Direction cross(const Direction& a, const Direction& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

// a + factor * b.
inline Direction add(const Direction& a, const Direction& b, double factor) {
  return {a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]};
}

inline Direction normalized(const Direction& d) {
  const double length = std::sqrt(dot(d, d));
  return {d[0] / length, d[1] / length, d[2] / length};
}

// *sum += weight * color, of R, G and B. `color` may have an alpha.
template <typename Color>
void accumulate(Rgb* sum, const Color& color, double weight) {
  for (size_t n = 0; n < 3; ++n) (*sum)[n] += weight * color[n];
}

}  // namespace candela::reference
