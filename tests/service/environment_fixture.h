// A server and the panoramas that tests put on it.
#pragma once

#include <Imath/half.h>
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <memory>
#include <string>
#include <vector>

#include "client/panorama.h"
#include "proto/candela/v1/environment_id.h"
#include "tests/service/service_fixture.h"
#include "tests/support/status.h"

namespace candela::testing {

using HalfTexel = std::array<Imath::half, 4>;

// A panorama of halves. `color` gives R, G and B of texel (x, y).
template <typename Color>
std::shared_ptr<const Panorama> make_panorama(uint32_t width, uint32_t height, Color color) {
  auto texels = std::make_shared<std::vector<HalfTexel>>();
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      const std::array<float, 3> c = color(x, y);
      texels->push_back({c[0], c[1], c[2], 1.0f});
    }
  }
  auto panorama = std::make_shared<Panorama>();
  panorama->start.set_width(width);
  panorama->start.set_height(height);
  panorama->start.set_format(v1::PIXEL_FORMAT_RGBA16F);
  panorama->pixels = std::as_bytes(std::span(*texels));
  panorama->owner = texels;
  return panorama;
}

inline std::shared_ptr<const Panorama> uniform(float value, uint32_t width = 64) {
  return make_panorama(width, width / 2, [value](uint32_t, uint32_t) {
    return std::array<float, 3>{value, value, value};
  });
}

// Bright on the right half and dark on the left, so that a turning camera has to adapt.
inline std::shared_ptr<const Panorama> two_halves() {
  return make_panorama(64, 32, [](uint32_t x, uint32_t y) {
    const float value = (x < 32 ? 0.05f : 20.0f) * (1.0f + 0.01f * static_cast<float>(y));
    return std::array<float, 3>{value, 0.5f * value, 0.25f * value};
  });
}

inline v1::View view_of(const std::string& id, double yaw_deg = 0) {
  v1::View view;
  view.set_environment(id);
  view.mutable_camera()->set_yaw_deg(yaw_deg);
  return view;
}

inline FrameView frame_of(const v1::View& view, uint32_t width = 24, uint32_t height = 16) {
  FrameView frame{.width = width, .height = height};
  frame.view = view;
  return frame;
}

inline std::vector<HalfTexel> texels_of(std::span<const std::byte> bytes) {
  std::vector<HalfTexel> texels(bytes.size() / sizeof(HalfTexel));
  std::memcpy(texels.data(), bytes.data(), bytes.size());
  return texels;
}

class EnvironmentService : public ::testing::Test {
 protected:
  void SetUp() override { restart(test_config()); }

  void restart(const Config& config) {
    server_.reset();
    server_ = start_server(config);
  }
  // All memory, and the environments' part of it.
  void restart_with(uint64_t memory_mib, uint64_t environments_mib) {
    Config config = test_config();
    config.memory_budget_bytes = memory_mib << 20;
    config.environment_budget_bytes = environments_mib << 20;
    restart(config);
  }

  std::shared_ptr<grpc::Channel> channel() const { return server_->in_process_channel(); }
  Connection connection() const { return Connection(channel()); }
  std::string put(const Panorama& panorama) const {
    const absl::StatusOr<v1::Environment> environment = connection().put_environment(panorama);
    EXPECT_OK(environment);
    return environment.ok() ? environment->id() : "";
  }

  std::unique_ptr<Server> server_;
};

}  // namespace candela::testing
