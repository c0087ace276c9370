// Bakes of environments on a server.
#include <cmath>
#include <functional>

#include "absl/strings/str_cat.h"
#include "server/render/environment/environment.h"
#include "tests/service/environments/environment_fixture.h"

namespace candela::testing {
namespace {

using EnvironmentBakes = EnvironmentService;

// As RGBA16F.
v1::BakeEnvironmentRequest bake_of(const std::string& id) {
  v1::BakeEnvironmentRequest request;
  request.set_id(id);
  request.set_format(v1::PIXEL_FORMAT_RGBA16F);
  return request;
}

TEST_F(EnvironmentBakes, ABakeOfAUniformPanoramaIsUniformInEveryLevelAndFormat) {
  v1::BakeEnvironmentRequest request = bake_of(put(*uniform(0.5f, 256)));
  request.set_size(64);
  for (const v1::PixelFormat format : {v1::PIXEL_FORMAT_RGBA16F, v1::PIXEL_FORMAT_RGB9E5}) {
    request.set_format(format);
    ASSERT_OK_AND_ASSIGN(const EnvironmentBake bake, connection().bake_environment(request));
    ASSERT_EQ(bake.levels.size(), 3u);
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(bake.header.levels(i).size(), 64u >> i);
      EXPECT_NEAR(bake.header.levels(i).roughness(), 0.5 * i, 1e-6);
    }
    if (format != v1::PIXEL_FORMAT_RGBA16F) continue;
    for (const std::vector<std::byte>& level : bake.levels) {
      for (const HalfTexel& texel : texels_of(level)) ASSERT_NEAR(texel[1], 0.5f, 0.001f);
    }
  }
}

TEST_F(EnvironmentBakes, AskedForLevelsAreThoseOfTheWholeBake) {
  const auto panorama = make_panorama(128, 64, [](uint32_t x, uint32_t y) {
    return std::array<float, 3>{0.01f * static_cast<float>(x), 0.02f * static_cast<float>(y),
                                x < 9 ? 9.0f : 1};
  });
  v1::BakeEnvironmentRequest request = bake_of(put(*panorama));
  request.set_size(64);
  ASSERT_OK_AND_ASSIGN(const EnvironmentBake whole, connection().bake_environment(request));
  ASSERT_EQ(whole.levels.size(), 3u);
  for (uint32_t levels = 1; levels <= 3; ++levels) {
    request.set_levels(levels);
    ASSERT_OK_AND_ASSIGN(const EnvironmentBake bake, connection().bake_environment(request));
    ASSERT_EQ(bake.levels.size(), levels);
    for (uint32_t i = 0; i < levels; ++i) {
      const int row = static_cast<int>(i);
      EXPECT_EQ(bake.header.levels(row).roughness(), whole.header.levels(row).roughness());
      EXPECT_TRUE(bake.levels[i] == whole.levels[i]) << levels << ": " << i;
    }
  }
}

TEST_F(EnvironmentBakes, OnlyTheLevelsThatAreAskedForTakeMemory) {
  restart_with(11, 4);
  const bool unified = connection().server_info()->device().unified_memory();
  v1::BakeEnvironmentRequest request = bake_of(put(*uniform(0.5f)));
  request.set_size(256);
  for (const uint32_t levels : {0u, 4u, 3u}) {
    request.set_levels(levels);
    const uint32_t made = levels == 0 ? 5 : levels;
    uint64_t bytes = chain_bytes(256) + cube_bytes(128, made - 1);
    if (!unified) bytes += cube_bytes(256, 1) / 6;  // the copy of a face
    for (uint32_t level = 0; level < made; ++level)
      bytes += uint64_t{6 * 8} * (256 >> level) * (256 >> level);
    EXPECT_REFUSED(kResourceExhausted, absl::StrCat("needs ", bytes, " bytes"),
                   connection().bake_environment(request));
  }
  // Level 0 and its faces on the wire fit.
  request.set_levels(1);
  EXPECT_OK(connection().bake_environment(request));
}

TEST_F(EnvironmentBakes, WhatRgb9e5DoesNotHoldIsCountedOverTheFacesThatAreSent) {
  v1::BakeEnvironmentRequest request = bake_of(put(*make_panorama(64, 32, [](uint32_t, uint32_t) {
    return std::array<float, 3>{-1.0f, 65504.0f, 0.5f};
  })));
  request.set_size(32);
  const auto bake = [&](v1::PixelFormat format, uint32_t levels) {
    request.set_format(format);
    request.set_levels(levels);
    const absl::StatusOr<EnvironmentBake> baked = connection().bake_environment(request);
    EXPECT_OK(baked);
    return baked.ok() ? baked->header : v1::BakeHeader();
  };
  const uint64_t first = 6 * 32 * 32, both = first + 6 * 16 * 16;
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGB9E5, 1).negative_components(), first);
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGB9E5, 2).negative_components(), both);
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGB9E5, 2).clamped_components(), both);
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGBA16F, 2).negative_components(), 0u);
  EXPECT_EQ(bake(v1::PIXEL_FORMAT_RGBA16F, 2).clamped_components(), 0u);
}

TEST_F(EnvironmentBakes, AVerifiedBakeSaysTheErrorOfEachLevel) {
  const auto panorama = make_panorama(256, 128, [](uint32_t x, uint32_t y) {
    const float wave = std::sin(0.2f * static_cast<float>(x)) * std::cos(0.15f * static_cast<float>(y));
    return std::array<float, 3>{1.5f + wave, 1.0f - 0.5f * wave, x > 100 && x < 110 && y < 40 ? 30.0f : 0.2f};
  });
  v1::BakeEnvironmentRequest request = bake_of(put(*panorama));
  request.set_rotation_deg(33);
  EXPECT_FALSE(connection().bake_environment(request)->header.levels(0).has_error());
  request.set_verify(true);
  double error_of_draft = 0;
  for (const auto& [tier, most] : {std::pair("draft", 0.08), {"standard", 0.02}, {"reference", 0.003}}) {
    request.set_tier(tier);
    ASSERT_OK_AND_ASSIGN(const EnvironmentBake bake, connection().bake_environment(request));
    double sum = 0;
    for (const v1::BakedLevel& level : bake.header.levels()) {
      ASSERT_TRUE(level.has_error());
      EXPECT_LE(level.error(), most) << tier << ", level of " << level.size();
      sum += level.error();
    }
    if (error_of_draft == 0) error_of_draft = sum;
    EXPECT_GT(sum, 0);
    EXPECT_LE(sum, error_of_draft) << tier;
  }
}

TEST_F(EnvironmentBakes, ABadBakeIsRefused) {
  v1::BakeEnvironmentRequest good = bake_of(put(*uniform(0.5f)));
  const auto refused = [&](const std::function<void(v1::BakeEnvironmentRequest&)>& spoil, const char* field) {
    v1::BakeEnvironmentRequest request = good;
    spoil(request);
    EXPECT_REFUSED(kInvalidArgument, field, connection().bake_environment(request));
  };
  refused([](auto& r) { r.set_size(48); }, "size is 48; it must be a power of two between 16 and 4096");
  refused([](auto& r) { r.set_size(8192); }, "size is 8192; it must be a power of two between 16 and 4096");
  refused([](auto& r) { r.set_levels(9); }, "levels is 9; a cube of ");
  refused([](auto& r) { r.clear_format(); }, "format is 0; a bake is RGBA16F (1), RGBA32F (2) or RGB9E5 (3)");
  refused([](auto& r) { r.set_tier("best"); }, "tier is 'best'");
  refused([](auto& r) { r.set_rotation_deg(NAN); }, "rotation_deg is nan; it must be between -360 and 360");
  refused([](auto& r) { r.set_id("x"); }, "id");
}

}  // namespace
}  // namespace candela::testing
