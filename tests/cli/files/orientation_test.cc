// Which way round environments are, from the file of a panorama to the files of its cube map and to its
// views.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/baked_environment_support.h"

namespace candela {
namespace {

constexpr uint32_t kWidth = 256, kHeight = 128, kSide = 32;

// The direction of a texel (docs/environments.md section 1), as a point of the cube.
Vector panorama_point(uint32_t x, uint32_t y) {
  const double lon = 2 * std::numbers::pi * ((x + 0.5) / kWidth - 0.5);
  const double lat = std::numbers::pi * (0.5 - (y + 0.5) / kHeight);
  Vector point = {std::sin(lon) * std::cos(lat), std::sin(lat), -std::cos(lon) * std::cos(lat)};
  const double most = std::max({std::abs(point[0]), std::abs(point[1]), std::abs(point[2])});
  for (double& v : point) v /= most;
  return point;
}

Vector pixel(const Image& image, uint32_t x, uint32_t y) {
  std::array<half, 4> rgba;
  std::memcpy(rgba.data(), image.pixels.data() + y * image.row_bytes() + x * sizeof rgba, sizeof rgba);
  return {rgba[0], rgba[1], rgba[2]};
}

class Orientation : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_OK_AND_ASSIGN(Image image, make_image(kWidth, kHeight, ImageFormat::kRgba16f));
    std::byte* out = image.pixels.data();
    for (uint32_t y = 0; y < kHeight; ++y) {
      for (uint32_t x = 0; x < kWidth; ++x) {
        const Vector rgb = arrows(0, panorama_point(x, y));
        const half texel[4] = {half(static_cast<float>(rgb[0])), half(static_cast<float>(rgb[1])),
                               half(static_cast<float>(rgb[2])), half(1.0f)};
        std::memcpy(out, texel, sizeof texel);
        out += sizeof texel;
      }
    }
    ASSERT_OK(write_image(pano_, image));
  }

  void bake(const std::string& out, Handedness handedness) {
    candela_json({"environment", pano_, folder_.path(out), "-q", "--size", std::to_string(kSide),
                  "--handedness", name(handedness)});
  }

  Image picture(const std::string& file) {
    absl::StatusOr<Image> image = read_image(folder_.path(file));
    EXPECT_OK(image);
    return image.ok() ? *std::move(image) : Image();
  }

  const TemporaryFolder folder_;
  const std::string pano_ = folder_.path("pano.exr");
};

TEST_F(Orientation, AnArrowOfThePanoramaIsWhereAnEngineExpectsItInEveryFile) {
  for (const Handedness handedness : {Handedness::kLeft, Handedness::kRight}) {
    bake("a.ktx2", handedness);
    const Ktx2 file = parse_ktx2(folder_.path("a.ktx2"));
    expect_arrows(handedness, kSide,
                  [&](uint32_t face, uint32_t i, uint32_t j) { return file.texel(0, face, i, j); });
    bake("faces/", handedness);
    std::vector<Image> faces;
    for (const char* face : {"px", "nx", "py", "ny", "pz", "nz"}) {
      faces.push_back(picture(std::string("faces/") + face + ".exr"));
      ASSERT_EQ(faces.back().width, kSide);
    }
    expect_arrows(handedness, kSide,
                  [&](uint32_t face, uint32_t i, uint32_t j) { return pixel(faces[face], i, j); });
  }
}

// A camera sees a wall with its arrow up and the flag on the right. Of the ceiling it sees the arrow's foot
// on top, because it leans back; the floor has ahead on top.
TEST_F(Orientation, ACameraSeesTheArrowsAsTheyArePainted) {
  struct Look {
    const char *yaw, *pitch;
    bool head_at_top;
  };
  for (const auto& [yaw, pitch, head_at_top] :
       {Look{"0", "0", true}, Look{"90", "0", true}, Look{"180", "0", true}, Look{"-90", "0", true},
        Look{"0", "90", false}, Look{"0", "-90", true}}) {
    candela_json({"view", pano_, folder_.path("view.exr"), "-q", "--yaw", yaw, "--pitch", pitch, "--fov",
                  "90", "--size", "32x32", "--exposure", "0", "--curve", "linear", "--bloom-intensity", "0"});
    const Image view = picture("view.exr");
    ASSERT_EQ(view.width, kSide);
    const uint32_t low = 6, high = 25, middle = 16;
    // No wall's paper is as bright as that in both.
    const auto ink = [&](uint32_t x, uint32_t y) {
      const Vector rgb = pixel(view, x, y);
      return rgb[0] > 0.99 && rgb[1] > 0.99;
    };
    EXPECT_TRUE(ink(middle, head_at_top ? low : high)) << yaw << ", " << pitch;
    EXPECT_FALSE(ink(middle, head_at_top ? high : low)) << yaw << ", " << pitch;
    EXPECT_TRUE(ink(high, middle)) << yaw << ", " << pitch;
    EXPECT_FALSE(ink(low, middle)) << yaw << ", " << pitch;
  }
}

}  // namespace
}  // namespace candela
