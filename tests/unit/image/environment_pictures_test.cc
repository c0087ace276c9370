#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <numbers>

#include "client/environment/cube_faces.h"
#include "client/environment/pictures.h"
#include "proto/candela/v1/pixel_size.h"
#include "tests/support/status.h"
#include "tests/unit/image/baked_environment_support.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

Vector pixel(const Image& image, uint32_t x, uint32_t y) {
  return {component(image, x, y, 0), component(image, x, y, 1), component(image, x, y, 2)};
}

TEST(EnvironmentPictures, TheCrossIsWhatSomebodyInsideSees) {
  // Camera axes of each cell: forward, right, up. Looking up and down, the head is back and ahead.
  struct Cell {
    uint32_t column, row;
    Vector forward, right, up;
  };
  const Cell cells[] = {
      {0, 1, {-1, 0, 0}, {0, 0, -1}, {0, 1, 0}}, {1, 1, {0, 0, -1}, {1, 0, 0}, {0, 1, 0}},
      {2, 1, {1, 0, 0}, {0, 0, 1}, {0, 1, 0}},   {3, 1, {0, 0, 1}, {-1, 0, 0}, {0, 1, 0}},
      {1, 0, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}},   {1, 2, {0, -1, 0}, {1, 0, 0}, {0, 0, -1}},
  };
  BakedEnvironment environment = environment_of({32, 16}, telling);
  environment.handedness = Handedness::kRight;  // changes nothing
  for (size_t level = 0; level < 2; ++level) {
    const uint32_t size = 32u >> level;
    ASSERT_OK_AND_ASSIGN(const auto cross, cross_picture(environment, level));
    ASSERT_EQ(cross.width, 4 * size);
    ASSERT_EQ(cross.height, 3 * size);
    uint32_t seen = 0;
    for (const Cell& cell : cells) {
      for (uint32_t n = 0; n < size * size; ++n, ++seen) {
        const double a = 2 * (n % size + 0.5) / size - 1, b = 1 - 2 * (n / size + 0.5) / size;
        Vector point;
        for (size_t k = 0; k < 3; ++k) point[k] = cell.forward[k] + a * cell.right[k] + b * cell.up[k];
        ASSERT_EQ(pixel(cross, cell.column * size + n % size, cell.row * size + n / size),
                  telling(level, point))
            << cell.column << " " << cell.row << ": " << n;
      }
    }
    uint32_t black = 0;
    for (uint32_t n = 0; n < 12 * size * size; ++n) {
      EXPECT_EQ(component(cross, n % (4 * size), n / (4 * size), 3), 1);
      black += pixel(cross, n % (4 * size), n / (4 * size)) == Vector{};
    }
    EXPECT_EQ(black + seen, 12 * size * size);
  }
  EXPECT_EQ(cross_picture(environment, 2).status().message(),
            "the environment has no level 2; it has 0 .. 1");
}

TEST(EnvironmentPictures, ALookupOnAnEdgeIsTheMeanOfTheTwoTexelsThatMeetThere) {
  for (const uint32_t size : {1u, 2u, 16u}) {
    const BakedEnvironment environment = environment_of({size}, telling);
    const CubeLookup lookup(environment, 0);
    const double inner = 1 - 1.0 / size;
    for (size_t axis = 0; axis < 3; ++axis) {
      for (const auto& [p, q] : {std::pair{1, 1}, std::pair{1, -1}, std::pair{-1, 1}, std::pair{-1, -1}}) {
        for (uint32_t i = 0; i < size; ++i) {
          Vector a, b;
          a[axis] = b[axis] = 2 * (i + 0.5) / size - 1;
          const size_t u = (axis + 1) % 3, v = (axis + 2) % 3;
          a[u] = p, a[v] = q * inner;
          b[u] = p * inner, b[v] = q;
          std::array<float, 3> d;
          d[axis] = static_cast<float>(a[axis]), d[u] = static_cast<float>(p), d[v] = static_cast<float>(q);
          const std::array<float, 3> found = lookup.at(d);
          for (size_t c = 0; c < 3; ++c) {
            ASSERT_NEAR(found[c], (telling(0, a)[c] + telling(0, b)[c]) / 2, 1e-6) << size << " " << axis;
          }
        }
      }
    }
  }
}

TEST(EnvironmentPictures, ALookupAtACornerIsTheMeanOfTheThreeTexelsThatMeetThere) {
  const BakedEnvironment environment = environment_of({16}, telling);
  const CubeLookup lookup(environment, 0);
  const double inner = 1 - 1.0 / 16;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector sign = {corner & 1 ? 1.0 : -1.0, corner & 2 ? 1.0 : -1.0, corner & 4 ? 1.0 : -1.0};
    Vector mean{};
    for (size_t face = 0; face < 3; ++face) {
      Vector point = {inner * sign[0], inner * sign[1], inner * sign[2]};
      point[face] = sign[face];
      for (size_t c = 0; c < 3; ++c) mean[c] += telling(0, point)[c] / 3;
    }
    const auto found =
        lookup.at({static_cast<float>(sign[0]), static_cast<float>(sign[1]), static_cast<float>(sign[2])});
    for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(found[c], mean[c], 1e-6) << corner;
  }
}

TEST(EnvironmentPictures, ThePanoramaShowsTheWorldWithoutASeam) {
  for (const bool words : {false, true}) {
    BakedEnvironment environment = environment_of({32, 16}, telling);
    if (words) convert_to_rgb9e5(environment);
    for (size_t level = 0; level < 2; ++level) {
      const uint32_t size = 32u >> level, width = 4 * size, height = 2 * size;
      ASSERT_OK_AND_ASSIGN(const auto panorama, equirectangular_picture(environment, level));
      ASSERT_EQ(panorama.width, width);
      ASSERT_EQ(panorama.height, height);
      uint32_t inside = 0;
      for (uint32_t n = 0; n < width * height; ++n) {
        const double lon = 2 * std::numbers::pi * ((n % width + 0.5) / width - 0.5),
                     lat = std::numbers::pi * (0.5 - (n / width + 0.5) / height);
        Vector d = {std::sin(lon) * std::cos(lat), std::sin(lat), -std::cos(lon) * std::cos(lat)};
        const double largest = std::max({std::abs(d[0]), std::abs(d[1]), std::abs(d[2])});
        int near_edge = -1;
        for (double& v : d) {
          v /= largest;
          near_edge += std::abs(v) > 1 - 1.0 / size;
        }
        // The scene is linear on each face, so a lookup is exact there, and less than a texel off at edges.
        const double tolerance = near_edge > 0 ? std::ldexp(1.0, static_cast<int>(level)) / size
                                               : std::ldexp(3.0, static_cast<int>(level) - 11);
        inside += near_edge == 0;
        for (int c = 0; c < 3; ++c) {
          ASSERT_NEAR(component(panorama, n % width, n / width, c), telling(level, d)[c], tolerance);
        }
      }
      EXPECT_GT(inside, width * height * 3 / 4);
    }
  }
}

TEST(EnvironmentPictures, ASheetHasItsPicturesSideBySideInAnyFormat) {
  for (const ImageFormat format :
       {ImageFormat::kRgba8, ImageFormat::kRgba16, ImageFormat::kRgba16f, ImageFormat::kRgba32f}) {
    std::vector<Image> pictures;
    for (const uint32_t size : {3u, 2u}) {
      Image& picture = pictures.emplace_back(*make_image(4 * size, 3 * size, format));
      for (size_t i = 0; i < picture.pixels.size(); ++i) picture.pixels.data()[i] = std::byte(1 + i % 50);
    }
    ASSERT_OK_AND_ASSIGN(const auto sheet, preview_sheet(pictures, 5));
    EXPECT_EQ(sheet.format, format);
    ASSERT_EQ(sheet.width, 5u + 12 + 5 + 8 + 5);
    ASSERT_EQ(sheet.height, 5u + 9 + 5);
    const float opaque = format == ImageFormat::kRgba8 ? 255 : format == ImageFormat::kRgba16 ? 65535 : 1;
    for (uint32_t y = 0; y < sheet.height; ++y) {
      for (uint32_t x = 0; x < sheet.width; ++x) {
        const bool first = x >= 5 && x < 17 && y >= 5 && y < 14,
                   second = x >= 22 && x < 30 && y >= 5 && y < 11;
        for (int c = 0; c < 4; ++c) {
          const float expected = first    ? component(pictures[0], x - 5, y - 5, c)
                                 : second ? component(pictures[1], x - 22, y - 5, c)
                                 : c == 3 ? opaque
                                          : 0;
          ASSERT_EQ(component(sheet, x, y, c), expected) << x << ", " << y;
        }
      }
    }
  }
  std::vector<Image> mixed;
  mixed.push_back(*make_image(4, 3, ImageFormat::kRgba8));
  mixed.push_back(*make_image(4, 3, ImageFormat::kRgba16));
  EXPECT_EQ(preview_sheet(mixed, 1).status().message(),
            "a preview sheet has pictures of one format, not rgba8 and rgba16");
  EXPECT_FALSE(preview_sheet({}, 1).ok());
}

TEST(Rgb9e5, HasNoNegativeLightAndNoNaN) {
  EXPECT_EQ(v1::pack_rgb9e5({-1, 1, 65504}), 31u << 27 | 511u << 18);  // 1 is less than half of a step of 128
  EXPECT_EQ(v1::pack_rgb9e5({NAN, INFINITY, -INFINITY}), 31u << 27 | 511u << 9);
  EXPECT_EQ(v1::pack_rgb9e5({-0.0f, 65408, 0}), 31u << 27 | 511u << 9);
  EXPECT_EQ(v1::pack_rgb9e5({1, 2, 3}), 17u << 27 | 384u << 18 | 256u << 9 | 128u);
}

TEST(Rgb9e5, PacksToTheNearestStepOfTheSmallestExponent) {
  uint64_t state = 1;
  for (int n = 0; n < 200000; ++n) {
    std::array<float, 3> rgb;
    for (float& v : rgb) {
      state = state * 6364136223846793005u + 1442695040888963407u;
      v = std::ldexp(static_cast<float>(state >> 40), static_cast<int>(state >> 33 & 31) - 24 - 15);
    }
    const uint32_t word = v1::pack_rgb9e5(rgb);
    const double step = std::exp2(static_cast<double>(word >> 27) - 24);
    const float largest = std::max({rgb[0], rgb[1], rgb[2]});
    ASSERT_TRUE(word >> 27 == 0 || largest >= 255.75 * step) << largest << " needs a smaller exponent";
    for (size_t c = 0; c < 3; ++c) {
      const double v = std::min(static_cast<double>(rgb[c]), 65408.0);
      ASSERT_LE(std::abs(step * (word >> 9 * c & 511) - v), step / 2) << rgb[c];
      ASSERT_EQ(v1::unpack_rgb9e5(word)[c], static_cast<float>(step * (word >> 9 * c & 511)));
    }
    ASSERT_EQ(v1::pack_rgb9e5(v1::unpack_rgb9e5(word)), word);
  }
  EXPECT_EQ(v1::pack_rgb9e5({0, 0, 0}), 0u);
  EXPECT_EQ(v1::pack_rgb9e5({std::exp2(-24.0f), 0, 0}), 1u);
  EXPECT_EQ(v1::pack_rgb9e5({std::exp2(-26.0f), 0, 0}), 0u);
}

}  // namespace
}  // namespace candela
