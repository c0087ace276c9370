// Views of an environment whose levels are not baked, which only a device can, but made of exact arithmetic.
#include <half.h>

#include "absl/strings/str_cat.h"
#include "server/render/environment/view_tiles.h"
#include "tests/bits/bits.h"
#include "tests/support/settings.h"

namespace candela::testing {

namespace {

constexpr uint32_t kCubeSize = 64;

// Smooth light with noise, as a level has it that was made of a finer one.
CubeLevels levels_of_noise(TexturePool& pool, uint32_t size, uint32_t levels, uint32_t channel) {
  const auto texels = static_cast<uint32_t>(cube_bytes(size, levels) / kCubeTexelBytes);
  CubeLevels cube = {pool.take({texels, 1, kCubeTexelBytes}).value(), size, levels};
  auto* to = reinterpret_cast<float*>(cube.texels.buffer().mapped());
  for (uint32_t i = 0; i < texels; ++i) {
    for (uint32_t k = 0; k < 4; ++k) {
      to[4 * i + k] = steps_of_light(8 * noise(i, k, channel) - 5) + 0.001f * static_cast<float>(i % 97);
    }
  }
  return cube;
}

BakedCube cube_of_noise(TexturePool& pool) {
  BakedCube cube;
  cube.chain = levels_of_noise(pool, kCubeSize, chain_levels(kCubeSize), 1);
  cube.specular = levels_of_noise(pool, kCubeSize / 2, specular_levels(kCubeSize) - 1, 2);
  return cube;
}

std::vector<uint16_t> brdf_of_noise() {
  std::vector<uint16_t> halves(size_t{2} * shader::BRDF_SIZE * shader::BRDF_SIZE);
  for (uint32_t i = 0; i < halves.size(); ++i) halves[i] = imath_float_to_half(noise(i, 0, 4));
  return halves;
}

View turned(double fov_deg, double rotation_deg = 0) {
  View view;
  view.camera.rotation = camera_rotation(20, 15, 30);
  view.camera.fov_deg = fov_deg;
  view.rotation_deg = rotation_deg;
  return view;
}

struct NamedView {
  std::string name;
  View view;
};

// Level 0 alone, both sides of where it ends, two levels everywhere, and spheres of every kind.
std::vector<NamedView> views() {
  std::vector<NamedView> all = {{"sky, 10 degrees", turned(10)},
                                {"sky, 22 degrees, turned by 71.3", turned(22, 71.3)},
                                {"sky, 150 degrees", turned(150)}};
  for (const uint32_t samples : {1u, 4u, 16u}) {
    View view = turned(50);
    view.samples = samples;
    view.objects = lookdev_objects();
    view.objects.push_back({{0.5, 0.2, -5}, 1.2, {0.3, 0.9, 0.1}, 0.5, 0.1, true});
    view.objects.push_back({{-0.7, 0.3, -4}, 0.4, {1, 1, 1}, 1, 0.02, true});
    all.push_back({absl::StrCat("spheres, ", samples, " samples"), view});
  }
  return all;
}

Bits draw(Bench& bench, const View& view, Size size, bool floats) {
  const Settings settings = Settings::from({}).value();
  const v1::PixelFormat format = floats ? v1::PIXEL_FORMAT_RGBA32F : v1::PIXEL_FORMAT_RGBA16F;
  FrameMemory memory = bench.take(layout_textures({size.width, size.height, format}, settings), Verify::kNo);
  const BakedCube cube = cube_of_noise(bench.pool);
  Harmonics irradiance;
  for (uint32_t i = 0; i < irradiance.size(); ++i) {
    for (uint32_t k = 0; k < 3; ++k) irradiance[i][k] = (i == 0 ? 4 : 0) + double{noise(i, k, 6)} - 0.5;
  }
  const std::vector<shader::ViewObject> objects = view_objects(view, cube.specular, brdf_of_noise());
  draw_on_host(cube, floats, view, view_light(irradiance), objects, memory, bench.executor.crew());
  Bits bits;
  for (uint32_t y = 0; y < size.height; ++y) bits.pixels.add(memory.input_row(y));
  return bits;
}

}  // namespace

std::vector<Case> view_cases() {
  std::vector<Case> all;
  for (const auto& [name, view] : views()) {
    for (const Size size : {Size{17, 3}, Size{66, 35}, Size{641, 47}}) {
      const bool floats = size.width % 2 == 0;
      all.push_back({absl::StrCat(name, ", ", size.width, "x", size.height),
                     [=, view = view](Bench& bench) { return draw(bench, view, size, floats); }});
    }
  }
  return all;
}

}  // namespace candela::testing
