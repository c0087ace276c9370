// Views of environments, and their float64 twins.
#pragma once

#include <half.h>

#include "server/render/frame/frame_textures.h"
#include "server/render/host/host_executor.h"
#include "tests/device/environments/environment_fixture.h"

namespace candela::testing {

struct Picture {
  uint32_t width = 0;
  uint32_t height = 0;
  std::vector<std::array<float, 4>> texels;
};

// What the twin looks at: what the device has baked.
struct TwinStage {
  std::vector<reference::CubeLevel> chain;
  std::vector<reference::CubeLevel> specular;
  std::vector<reference::BrdfSum> brdf;
  std::vector<reference::Sphere> objects;
  reference::ViewScene scene;
};

// Grey, the largest magnitude among each texel and its neighbours, also across edges.
inline reference::CubeLevel bound_of(const reference::CubeLevel& level) {
  reference::CubeLevel out = level;
  for (uint32_t at = 0; at < level.texels.size(); ++at) {
    const uint32_t face = at / (level.size * level.size), j = at / level.size % level.size,
                   i = at % level.size;
    double most = 0;
    for (int b = -1; b <= 1; ++b) {
      for (int a = -1; a <= 1; ++a) {
        const double s = (2.0 * (static_cast<int>(i) + a) + 1) / level.size - 1;
        const double t = (2.0 * (static_cast<int>(j) + b) + 1) / level.size - 1;
        const NearestTexel n = nearest_texel(reference::cube_point({face, s, t}), level.size);
        most = std::max(most, largest(level.at(n.face, n.i, n.j)));
      }
    }
    out.texels[at] = {most, most, most};
  }
  return out;
}

class EnvironmentViewTest : public ::testing::TestWithParam<MachineKind> {
 protected:
  void SetUp() override {
    const std::string why = HostExecutor::unavailable(machine().device->summary());
    if (GetParam() == MachineKind::kHost && !why.empty()) GTEST_SKIP() << why;
  }

  Machine& machine() { return Machine::of(GetParam()); }
  EnvironmentBaker& baker() { return *machine().baker; }

  Environment ready(const WireFrame& frame) {
    Environment environment = environment_of(baker(), frame);
    EXPECT_OK(baker().prepare_view(environment, kDraft));
    return environment;
  }

  FrameMemory memory_for(uint32_t width, uint32_t height, Verify verify = Verify::kNo) {
    absl::StatusOr<FrameMemory> memory =
        machine().renderer->allocate({width, height, v1::PIXEL_FORMAT_RGBA16F}, *Settings::from({}), verify);
    EXPECT_OK(memory);
    return *std::move(memory);
  }

  Picture render(Environment& environment, const View& view, uint32_t width, uint32_t height) {
    FrameMemory memory = memory_for(width, height);
    EXPECT_OK(baker().render_view(environment, view, memory));
    Picture picture{width, height, {}};
    for (uint32_t y = 0; y < height; ++y) {
      const auto* halves = reinterpret_cast<const uint16_t*>(memory.input_row(y).data());
      for (uint32_t x = 0; x < width; ++x, halves += 4) {
        picture.texels.push_back({imath_half_to_float(halves[0]), imath_half_to_float(halves[1]),
                                  imath_half_to_float(halves[2]), imath_half_to_float(halves[3])});
      }
    }
    return picture;
  }

  std::unique_ptr<TwinStage> stage_of(Environment& environment, const View& view) {
    auto stage = std::make_unique<TwinStage>();
    stage->chain = levels_of(baker(), environment.view.chain);
    stage->specular = levels_of(baker(), environment.view.specular);
    stage->specular.insert(stage->specular.begin(), stage->chain[0]);
    const std::span<const uint16_t> table = *baker().brdf_table();
    for (size_t i = 0; i < table.size(); i += 2) {
      stage->brdf.push_back({imath_half_to_float(table[i]), imath_half_to_float(table[i + 1])});
    }
    for (const ViewSphere& s : view.objects) {
      stage->objects.push_back(
          {s.centre, s.radius, s.base_color, s.metallic, s.roughness, s.fixed_to_camera});
    }
    stage->scene = {stage->chain, stage->specular,   irradiance_of(*baker().radiance(environment)),
                    stage->brdf,  view.rotation_deg, stage->objects};
    return stage;
  }

  void expect_twin(Environment& environment, const View& view, uint32_t width, uint32_t height,
                   const std::string& what);
};

// Each pixel within 2^-10 of the largest texels that it uses, beside the rounding to halves.
inline void EnvironmentViewTest::expect_twin(Environment& environment, const View& view, uint32_t width,
                                             uint32_t height, const std::string& what) {
  const Picture is = render(environment, view, width, height);
  const std::unique_ptr<TwinStage> stage = stage_of(environment, view);
  TwinStage most = *stage;
  for (reference::CubeLevel& level : most.chain) level = bound_of(level);
  for (reference::CubeLevel& level : most.specular) level = bound_of(level);
  most.scene.chain = most.chain;
  most.scene.specular = most.specular;
  double all = 0;
  for (const auto& c : stage->scene.irradiance) all += largest(c);
  most.scene.irradiance = {};
  most.scene.irradiance[0] = {all, all, all};
  const reference::Camera camera = {view.camera.rotation, view.camera.position, view.camera.fov_deg};
  size_t near = 0;
  for (uint32_t y = 0; y < height; ++y) {
    std::vector<bool> near_edge;
    const auto should = view_row(stage->scene, camera, width, height, view.samples, y, &near_edge);
    const auto bound = view_row(most.scene, camera, width, height, view.samples, y);
    for (uint32_t x = 0; x < width; ++x) {
      const std::array<float, 4>& texel = is.texels[size_t{y} * width + x];
      ASSERT_EQ(texel[3], 1.0f);
      near += near_edge[x];
      for (size_t k = 0; k < 3 && !near_edge[x]; ++k) {
        const double clamped = std::clamp(should[x][k], -65504.0, 65504.0);
        ASSERT_NEAR(texel[k], clamped, largest(bound[x]) / 1024 + std::abs(clamped) / 2048 + 3e-8)
            << what << " pixel " << x << ", " << y;
      }
    }
  }
  EXPECT_LE(near, 4 + size_t{width} * height / 50) << what;
}

inline View turned_view(double yaw, double pitch, double roll, double fov_deg) {
  View view;
  view.camera.rotation = camera_rotation(yaw, pitch, roll);
  view.camera.fov_deg = fov_deg;
  return view;
}

inline std::vector<WireFrame> panoramas_to_view() {
  return {natural(1, 1),     natural(2, 1),  natural(3, 2),  natural(97, 41),
          natural(512, 256), natural(1, 64), sun_at(160, 38)};
}

}  // namespace candela::testing
