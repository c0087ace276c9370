// Environments on a device with unified memory and on one without, and what tests compare them with.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/render/environment/environment_baker.h"
#include "server/render/renderer.h"
#include "server/render/settings/tiers.h"
#include "shaders/environment/environment.h"
#include "tests/support/clock.h"
#include "tests/support/device_fixture.h"
#include "tests/support/files.h"
#include "tests/support/scenes.h"
#include "tests/support/status.h"

namespace candela::testing {

// What a tier's row says.
inline BakeQuality quality_of(const char* tier) {
  const Tier* row = find_tier(tier);
  return {row->cube_samples, row->specular_detail};
}
inline const BakeQuality kDraft = quality_of("draft");
inline const BakeQuality kStandard = quality_of("standard");
inline const BakeQuality kReference = quality_of("reference");

// Whether the device's memory is the host's, too; and if so, who draws views.
enum class MachineKind : uint32_t { kUnified, kStaging, kHost };
inline constexpr std::array<const char*, 3> kMachineWords = {"Unified", "Staging", "Host"};

// A device with everything that bakes and renders on it. One of each kind in a process.
struct Machine {
  std::unique_ptr<Device> device;
  std::unique_ptr<TexturePool> pool;
  std::unique_ptr<Renderer> renderer;
  std::unique_ptr<Crew> crew;
  std::unique_ptr<EnvironmentBaker> baker;

  static Machine& of(MachineKind kind) {
    Machine& m = all()[static_cast<uint32_t>(kind)];
    if (m.baker) return m;
    keep_driver_loaded();
    DeviceOptions options;
    options.staging = kind == MachineKind::kStaging;
    m.device = *Device::create(options);
    m.pool = std::make_unique<TexturePool>(*m.device, uint64_t{4} << 30, real_clock());
    m.renderer = *Renderer::create(*m.device, *m.pool);
    if (kind == MachineKind::kHost) m.crew = std::make_unique<Crew>(3);
    m.baker = *EnvironmentBaker::create(*m.device, *m.pool, m.crew.get());
    return m;
  }

  // Closed after the last test, and not by a destructor.
  static std::array<Machine, 3>& all() {
    static auto* const machines = new std::array<Machine, 3>;
    return *machines;
  }
};

inline ::testing::Environment* const close_machines =
    ::testing::AddGlobalTestEnvironment(new CloseAfterTests([] {
      for (Machine& m : Machine::all()) {
        m.baker.reset();
        m.crew.reset();
        m.renderer.reset();
        m.pool.reset();
        m.device.reset();
      }
    }));

inline Environment environment_of(EnvironmentBaker& baker, const WireFrame& frame,
                                  const std::optional<std::array<float, 9>>& matrix = std::nullopt) {
  absl::StatusOr<PanoramaUpload> upload = baker.take(frame.desc);
  EXPECT_OK(upload);
  for (uint32_t y = 0; y < frame.desc.height; ++y) {
    std::memcpy(upload->row(y).data(), frame.pixels.data() + y * frame.desc.row_bytes(),
                frame.desc.row_bytes());
  }
  absl::StatusOr<Environment> environment = baker.finish(*std::move(upload), matrix);
  EXPECT_OK(environment);
  return *std::move(environment);
}

inline reference::Scene scene_of(const WireFrame& frame,
                                 const std::optional<std::array<float, 9>>& matrix = std::nullopt,
                                 reference::BadCounts* counts = nullptr) {
  reference::BadCounts unused;
  return reference::ingest(frame.pixels, frame.desc.row_bytes(), frame.desc.width, frame.desc.height,
                           static_cast<uint32_t>(frame.desc.format), matrix, reference::Rounding::kHalf,
                           counts ? counts : &unused);
}

inline reference::CubeLevel level_of(EnvironmentBaker& baker, const CubeLevels& levels, uint32_t level) {
  reference::CubeLevel out{levels.size_of(level), {}};
  for (uint32_t face = 0; face < kCubeFaces; ++face) {
    const absl::StatusOr<std::vector<float>> rgb = baker.read_face(levels, level, face);
    EXPECT_OK(rgb);
    for (size_t i = 0; i < rgb->size(); i += 3)
      out.texels.push_back({(*rgb)[i], (*rgb)[i + 1], (*rgb)[i + 2]});
  }
  return out;
}

inline std::vector<reference::CubeLevel> levels_of(EnvironmentBaker& baker, const CubeLevels& levels) {
  std::vector<reference::CubeLevel> all;
  for (uint32_t level = 0; level < levels.levels; ++level) all.push_back(level_of(baker, levels, level));
  return all;
}

// Of all levels.
inline std::vector<reference::Rgb> texels_of(EnvironmentBaker& baker, const CubeLevels& levels) {
  std::vector<reference::Rgb> all;
  for (const reference::CubeLevel& level : levels_of(baker, levels))
    all.insert(all.end(), level.texels.begin(), level.texels.end());
  return all;
}

inline std::string name_of(const WireFrame& frame) {
  return std::to_string(frame.desc.width) + "x" + std::to_string(frame.desc.height);
}

inline double largest(const reference::Rgb& c) {
  return std::max({std::abs(c[0]), std::abs(c[1]), std::abs(c[2])});
}

// Each texel is grey, the largest magnitude among it and its neighbours, so that lookups in it bound the
// texels that a lookup in `scene` uses.
inline reference::Scene bound_of(const reference::Scene& scene) {
  reference::Scene out = scene;
  const auto magnitude = [&](uint32_t x, uint32_t y) {
    const auto& c = scene.texels[size_t{y} * scene.width + x];
    return std::max({std::abs(c[0]), std::abs(c[1]), std::abs(c[2])});
  };
  for (uint32_t y = 0; y < scene.height; ++y) {
    for (uint32_t x = 0; x < scene.width; ++x) {
      float most = 0;
      for (uint32_t j = y == 0 ? 0 : y - 1; j <= std::min(y + 1, scene.height - 1); ++j) {
        for (const uint32_t i : {(x + scene.width - 1) % scene.width, x, (x + 1) % scene.width}) {
          most = std::max(most, magnitude(i, j));
        }
      }
      out.texels[size_t{y} * scene.width + x] = {most, most, most, 1};
    }
  }
  return out;
}

// A sun of one texel in black.
inline constexpr uint32_t kSunWidth = 256, kSunHeight = 128;
inline WireFrame sun_at(uint32_t sun_x, uint32_t sun_y) {
  return make_frame(kSunWidth, kSunHeight, v1::PIXEL_FORMAT_RGBA16F, [=](uint32_t x, uint32_t y) -> Texel {
    const float v = x == sun_x && y == sun_y ? 65504.0f : 0.0f;
    return {v, v, v, 1};
  });
}

// The 64 directions of docs/environments.md section 7.
inline std::vector<reference::Direction> fibonacci_directions() {
  std::vector<reference::Direction> out;
  for (int i = 0; i < 64; ++i) {
    const double y = 1 - (2 * i + 1) / 64.0, across = std::sqrt(1 - y * y);
    const double lon = i * 3.14159265358979323846 * (3 - std::sqrt(5.0));
    out.push_back({std::sin(lon) * across, y, -std::cos(lon) * across});
  }
  return out;
}

// The texel of a level of `size` that is nearest to a direction.
struct NearestTexel {
  uint32_t face, i, j;
};
inline NearestTexel nearest_texel(const reference::Direction& d, uint32_t size) {
  const reference::CubeSpot spot = reference::cube_spot(d);
  const auto at = [&](double s) { return std::min(static_cast<uint32_t>((s + 1) / 2 * size), size - 1); };
  return {spot.face, at(spot.s), at(spot.t)};
}

// One-texel suns at a pole, the seam, the middle of a face, an edge and a corner of the cube.
inline std::vector<WireFrame> suns() {
  std::vector<WireFrame> frames;
  for (const auto& [x, y] : std::vector<std::array<uint32_t, 2>>{
           {40, 0}, {200, 127}, {0, 64}, {255, 50}, {128, 64}, {160, 64}, {160, 38}, {96, 89}}) {
    frames.push_back(sun_at(x, y));
  }
  return frames;
}

// True: without unified memory.
class EnvironmentTest : public ::testing::TestWithParam<bool> {
 protected:
  Machine& machine() { return Machine::of(GetParam() ? MachineKind::kStaging : MachineKind::kUnified); }
  EnvironmentBaker& baker() { return *machine().baker; }

  BakedCube bake(const Environment& environment, const BakeSpec& spec) {
    absl::StatusOr<BakedCube> cube = baker().bake(environment, spec);
    EXPECT_OK(cube);
    return *std::move(cube);
  }
};

}  // namespace candela::testing
