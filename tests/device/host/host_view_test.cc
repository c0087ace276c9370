// Views that the host draws, against those of the device, and with other threads and instruction sets. Both
// are compared with the float64 twin in environment_view_test.cc.
#include <gtest/gtest.h>

#include <cmath>

#include "server/render/environment/environment_baker.h"
#include "tests/device/host/host_fixture.h"

namespace candela::testing {
namespace {

class HostView : public HostTest {
 protected:
  // Null: the device draws.
  static std::unique_ptr<EnvironmentBaker> baker_with(Crew* crew) {
    auto baker = EnvironmentBaker::create(device(), pool(), crew);
    if (!baker.ok()) throw std::runtime_error(baker.status().ToString());
    return *std::move(baker);
  }

  static Environment environment_of(EnvironmentBaker& baker, const WireFrame& frame) {
    absl::StatusOr<PanoramaUpload> upload = baker.take(frame.desc);
    if (!upload.ok()) throw std::runtime_error(upload.status().ToString());
    for (uint32_t y = 0; y < frame.desc.height; ++y) {
      const auto row = upload->row(y);
      std::memcpy(row.data(), frame.pixels.data() + y * frame.desc.row_bytes(), frame.desc.row_bytes());
    }
    absl::StatusOr<Environment> environment = baker.finish(*std::move(upload), std::nullopt);
    if (!environment.ok()) throw std::runtime_error(environment.status().ToString());
    if (absl::Status status = baker.prepare_view(*environment, {4, 0.5}); !status.ok())
      throw std::runtime_error(status.ToString());
    return *std::move(environment);
  }

  // All bytes of the frame's input, with the padding of its rows, which nothing draws.
  static std::vector<std::byte> draw(EnvironmentBaker& baker, Environment& environment, const View& view,
                                     Size size) {
    absl::StatusOr<FrameMemory> memory = FrameMemory::take(
        pool(), device().summary(),
        layout_textures({size.width, size.height, v1::PIXEL_FORMAT_RGBA16F}, *Settings::from({})),
        Verify::kNo);
    if (!memory.ok()) throw std::runtime_error(memory.status().ToString());
    const TextureLayout& layout = memory->textures().layout;
    const Buffer& input = memory->textures().input.buffer();
    std::memset(input.mapped(), 0xff, input.bytes());
    if (absl::Status status = baker.render_view(environment, view, *memory); !status.ok())
      throw std::runtime_error(status.ToString());
    return {input.mapped(), input.mapped() + size_t{layout.pitch} * size.height * 8};
  }
};

View turned(double fov_deg) {
  View view;
  view.camera.rotation = camera_rotation(20, 15, 30);
  view.camera.fov_deg = fov_deg;
  return view;
}

// Level 0 alone, both sides of where it ends, two levels everywhere, and spheres of every kind.
std::vector<View> views() {
  std::vector<View> all = {turned(10), turned(22), turned(150)};
  for (const uint32_t samples : {1u, 4u, 16u}) {
    View view = turned(50);
    view.samples = samples;
    view.objects = lookdev_objects();
    // Behind and in one another.
    view.objects.push_back({{0.5, 0.2, -5}, 1.2, {0.3, 0.9, 0.1}, 0.5, 0.1, true});
    view.objects.push_back({{-0.7, 0.3, -4}, 0.4, {1, 1, 1}, 1, 0.02, true});
    all.push_back(view);
  }
  return all;
}

constexpr Size kViewSizes[] = {{1, 1}, {17, 3}, {66, 35}, {641, 47}};

class HostViewBits : public HostView {
 protected:
  static std::vector<std::vector<std::byte>> bits(uint32_t threads) {
    Crew crew(threads);
    const std::unique_ptr<EnvironmentBaker> baker = baker_with(&crew);
    Environment environment = environment_of(*baker, natural(512, 256));
    std::vector<std::vector<std::byte>> all;
    for (const View& view : views()) {
      for (const Size size : kViewSizes) all.push_back(draw(*baker, environment, view, size));
    }
    return all;
  }
};

TEST_F(HostViewBits, DoNotDependOnTheThreads) {
  const auto one = bits(1);
  for (const uint32_t threads : {2, 3, 7}) EXPECT_EQ(one, bits(threads)) << threads;
}

TEST_F(HostViewBits, DoNotDependOnTheInstructionSet) {
  const auto first = bits(2);
  on_each_instruction_set([&](const std::string& name) { EXPECT_EQ(first, bits(2)) << name; });
}

TEST_F(HostView, NothingBeyondARowIsTouched) {
  Crew crew(2);
  const std::unique_ptr<EnvironmentBaker> baker = baker_with(&crew);
  Environment environment = environment_of(*baker, flat(8, 4, {1, 1, 1, 1}));
  for (uint32_t width = 1; width <= 37; ++width) {
    for (const View& view : {turned(10), turned(150), views().back()}) {
      const std::vector<std::byte> pixels = draw(*baker, environment, view, {width, 3});
      const size_t pitch = pixels.size() / 3 / 8;
      for (size_t i = 0; i < pixels.size() / 8; ++i) {
        uint16_t halves[4];
        std::memcpy(halves, &pixels[i * 8], sizeof halves);
        EXPECT_EQ(halves[3], i % pitch < width ? 0x3c00 : 0xffff) << width << " wide, pixel " << i;
      }
    }
  }
}

// Black balls in white, each of which some pixel's ray touches: roundings decide whether the pixel shows it.
// Which ray meets which of them follows from operations that are rounded alike everywhere.
TEST_F(HostView, EveryPixelShowsTheDevicesObject) {
  Crew crew(2);
  const std::unique_ptr<EnvironmentBaker> on_host = baker_with(&crew), on_device = baker_with(nullptr);
  Environment environment = environment_of(*on_host, flat(8, 4, {1, 1, 1, 1}));
  for (uint32_t width = 120; width < 130; ++width) {
    View view = turned(70);
    const double p = 2 * std::tan(35 * 3.14159265358979323846 / 180) / 90;
    for (uint32_t i = 0; i < 60; ++i) {
      const double x = (i % 12 * 10 + 5.5 - width / 2.0) * p, y = (i / 12 * 18 + 7.5 - 45) * p;
      const double radius = 0.1 + 0.001 * i, away = 3 + noise(i, width, 0);
      const double across =
          radius / std::hypot(x, 1.0);  // along (1, 0, x), which is at a right angle to the ray
      view.objects.push_back(
          {{away * x + across, away * y, -away + across * x}, radius, {0, 0, 0}, 0, 1, true});
    }
    const auto host = draw(*on_host, environment, view, {width, 90});
    const auto device = draw(*on_device, environment, view, {width, 90});
    const size_t pitch = host.size() / 90 / 8;
    const auto is_ball = [&](const std::vector<std::byte>& pixels, size_t i) {
      uint16_t red;
      std::memcpy(&red, &pixels[i * 8], sizeof red);
      return red != 0x3c00;
    };
    for (size_t i = 0; i < host.size() / 8; ++i) {
      if (i % pitch >= width) continue;
      EXPECT_EQ(is_ball(host, i), is_ball(device, i)) << width << " wide, pixel " << i;
    }
  }
}

TEST_F(HostView, ARendererDrawsViewsWhereItMakesItsPasses) {
  Crew crew(2);
  const std::unique_ptr<EnvironmentBaker> on_host = baker_with(&crew), on_device = baker_with(nullptr);
  Environment environment = environment_of(*on_host, natural(512, 256));
  const View view = turned(60);
  const auto host = draw(*on_host, environment, view, {199, 99});
  const auto device = draw(*on_device, environment, view, {199, 99});
  EXPECT_NE(host, device);  // some roundings differ
  EXPECT_EQ(draw(renderer_with(ExecutorKind::kHost).baker(), environment, view, {199, 99}), host);
  EXPECT_EQ(draw(renderer_with(ExecutorKind::kDevice).baker(), environment, view, {199, 99}), device);
}

}  // namespace
}  // namespace candela::testing
