#include "client/environment/environment_files.h"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstring>
#include <nlohmann/json.hpp>
#include <numbers>

#include "client/environment/cube_faces.h"
#include "client/environment/pictures.h"
#include "client/image/image.h"
#include "proto/candela/v1/pixel_size.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/baked_environment_support.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

constexpr Handedness kHandednesses[] = {Handedness::kLeft, Handedness::kRight};
constexpr CubeFormat kFormats[] = {CubeFormat::kRgba16f, CubeFormat::kRgb9e5, CubeFormat::kRgba32f};

class EnvironmentFiles : public ::testing::Test {
 protected:
  TemporaryFolder folder_;

  // Written and read back.
  Ktx2 ktx2(BakedEnvironment environment, Handedness handedness = Handedness::kLeft,
            CubeFormat format = CubeFormat::kRgba16f) {
    environment.handedness = handedness;
    if (format == CubeFormat::kRgb9e5) convert_to_rgb9e5(environment);
    if (format == CubeFormat::kRgba32f) convert_to_floats(environment);
    EXPECT_OK(write_ktx2(folder_.path("a.ktx2"), environment));
    return parse_ktx2(folder_.path("a.ktx2"));
  }
};

TEST_F(EnvironmentFiles, TheHeaderSaysThatItIsACubeMapWithItsSpecularLevels) {
  EXPECT_EQ(ktx2(environment_of({64, 32, 16}, telling)).header,
            (std::array<uint32_t, 9>{97, 2, 64, 64, 0, 0, 6, 3, 0}));
  EXPECT_EQ(ktx2(environment_of({16}, telling), Handedness::kRight, CubeFormat::kRgb9e5).header,
            (std::array<uint32_t, 9>{123, 4, 16, 16, 0, 0, 6, 1, 0}));
  EXPECT_EQ(ktx2(environment_of({16}, telling), Handedness::kRight, CubeFormat::kRgba32f).header,
            (std::array<uint32_t, 9>{109, 4, 16, 16, 0, 0, 6, 1, 0}));
}

// The words that Khronos' dfdutils make for VK_FORMAT_R16G16B16A16_SFLOAT, VK_FORMAT_R32G32B32A32_SFLOAT and
// VK_FORMAT_E5B9G9R9_UFLOAT_PACK32.
TEST_F(EnvironmentFiles, TheDataFormatDescriptorIsKhronosOwnWordForWord) {
  const std::vector<uint32_t> halves = {
      0x5c,       0, 0x580002,   0x10101,    0, 8, 0,  //
      0xc00f0000, 0, 0xbf800000, 0x3f800000,           // red
      0xc10f0010, 0, 0xbf800000, 0x3f800000,           // green
      0xc20f0020, 0, 0xbf800000, 0x3f800000,           // blue
      0xcf0f0030, 0, 0xbf800000, 0x3f800000,           // alpha
  };
  const std::vector<uint32_t> floats = {
      0x5c,       0, 0x580002,   0x10101,    0, 16, 0,  //
      0xc01f0000, 0, 0xbf800000, 0x3f800000,            // red
      0xc11f0020, 0, 0xbf800000, 0x3f800000,            // green
      0xc21f0040, 0, 0xbf800000, 0x3f800000,            // blue
      0xcf1f0060, 0, 0xbf800000, 0x3f800000,            // alpha
  };
  const std::vector<uint32_t> words = {
      0x7c,       0, 0x780002, 0x10101, 0,          4, 0,       //
      0x00080000, 0, 0,        8448,    0x2004001b, 0, 15, 31,  // red
      0x01080009, 0, 0,        8448,    0x2104001b, 0, 15, 31,  // green
      0x02080012, 0, 0,        8448,    0x2204001b, 0, 15, 31,  // blue
  };
  EXPECT_EQ(ktx2(environment_of({16}, telling)).descriptor, halves);
  EXPECT_EQ(ktx2(environment_of({16}, telling), Handedness::kLeft, CubeFormat::kRgba32f).descriptor, floats);
  EXPECT_EQ(ktx2(environment_of({16}, telling), Handedness::kLeft, CubeFormat::kRgb9e5).descriptor, words);
}

TEST_F(EnvironmentFiles, LevelsAreStoredFromTheSmallestOnAndAlignedWithoutAGap) {
  for (const CubeFormat format : kFormats) {
    for (const std::vector<uint32_t>& sizes :
         {std::vector<uint32_t>{16}, std::vector<uint32_t>{32, 16}, std::vector<uint32_t>{8, 4, 2, 1}}) {
      const Ktx2 file = ktx2(environment_of(sizes, telling), Handedness::kLeft, format);
      EXPECT_EQ(file.descriptor_at, 80 + 24 * sizes.size());
      EXPECT_EQ(file.descriptor[0], file.descriptor_bytes);
      EXPECT_EQ(file.keys_at, file.descriptor_at + file.descriptor_bytes);
      EXPECT_EQ(file.global_at, 0u);
      EXPECT_EQ(file.global_bytes, 0u);
      const uint64_t texel = bytes_per_texel(format), head = file.keys_at + file.keys_bytes;
      uint64_t at = (head + texel - 1) / texel * texel;
      for (uint64_t i = head; i < at; ++i) EXPECT_EQ(file.file[i], '\0') << i;
      for (size_t level = sizes.size(); level-- > 0;) {
        EXPECT_EQ(file.levels[level].offset, at);
        EXPECT_EQ(file.levels[level].bytes, 6 * texel * sizes[level] * sizes[level]);
        EXPECT_EQ(file.levels[level].unpacked_bytes, file.levels[level].bytes);
        at += file.levels[level].bytes;
      }
      EXPECT_EQ(file.file.size(), at);
    }
  }
}

TEST_F(EnvironmentFiles, TheHeadIsPaddedToTheTexelWhateverTheTextsLengths) {
  std::array<bool, 8> seen{};
  for (uint32_t digits = 0; digits < 8; ++digits) {
    BakedEnvironment environment = environment_of({16}, telling);
    environment.harmonics[0][0] = std::pow(10.0f, static_cast<float>(digits));
    const Ktx2 file = ktx2(std::move(environment));
    EXPECT_EQ(file.levels[0].offset % 8, 0u);
    seen[(file.keys_at + file.keys_bytes) % 8] = true;
  }
  EXPECT_TRUE(seen[0] && seen[4]);
}

TEST_F(EnvironmentFiles, KeysAreSortedAndSayWhatACubeMapCannot) {
  BakedEnvironment environment = environment_of({64, 32, 16}, telling);
  environment.levels[1].roughness = static_cast<float>(1 - std::sqrt(0.5));
  const Ktx2 file = ktx2(std::move(environment));
  std::vector<std::string> keys;
  for (const auto& [key, value] : file.entries) keys.push_back(key);
  EXPECT_EQ(keys, (std::vector<std::string>{"KTXorientation", "KTXwriter", "candela.handedness",
                                            "candela.roughness", "candela.sh"}));
  EXPECT_EQ(file.value("KTXorientation"), "rd");
  EXPECT_EQ(file.value("KTXwriter"), "candela " CANDELA_VERSION);
  EXPECT_EQ(file.value("candela.handedness"), "left");
  EXPECT_EQ(file.value("candela.roughness"), "0 0.292893231 1");
  EXPECT_EQ(
      file.value("candela.sh"),
      "0.333333343 0.666666687 1 1.33333337 1.66666663 2 2.33333325 2.66666675 3 3.33333325 3.66666675 "
      "4 4.33333349 4.66666651 5 5.33333349 5.66666651 6 6.33333349 6.66666651 7 7.33333349 7.66666651 8 "
      "8.33333302 8.66666698 9");
  const Ktx2 single = ktx2(environment_of({16}, telling), Handedness::kRight);
  EXPECT_EQ(single.value("candela.handedness"), "right");
  EXPECT_EQ(single.value("candela.roughness"), "0");
}

// The file's faces are at the points of the cube that every graphics interface gives them. There they hold
// the world mirrored in x, or the world.
TEST_F(EnvironmentFiles, EveryTexelOfEveryFaceAndLevelIsTheWorldsForBothHandednesses) {
  for (const std::vector<uint32_t>& sizes : {std::vector<uint32_t>{64, 32, 16}, std::vector<uint32_t>{16}}) {
    for (const Handedness handedness : kHandednesses) {
      for (const CubeFormat format : kFormats) {
        const Ktx2 file = ktx2(environment_of(sizes, telling), handedness, format);
        for (size_t level = 0; level < sizes.size(); ++level) {
          for (uint32_t n = 0; n < 6 * sizes[level] * sizes[level]; ++n) {
            const uint32_t i = n % sizes[level], j = n / sizes[level] % sizes[level],
                           face = n / (sizes[level] * sizes[level]);
            Vector point = cube_point(face, i, j, sizes[level]);
            if (handedness == Handedness::kLeft) point[0] = -point[0];
            ASSERT_EQ(file.texel(level, face, i, j), telling(level, point))
                << name(handedness) << " level " << level << " face " << face << " " << i << ", " << j;
          }
        }
      }
    }
  }
}

TEST_F(EnvironmentFiles, AnArrowOnEachFacePointsWhereAnEngineExpectsIt) {
  for (const Handedness handedness : kHandednesses) {
    const Ktx2 file = ktx2(environment_of({32, 16}, arrows), handedness);
    for (size_t level = 0; level < 2; ++level) {
      expect_arrows(handedness, 32u >> level,
                    [&](uint32_t face, uint32_t i, uint32_t j) { return file.texel(level, face, i, j); });
    }
  }
}

TEST_F(EnvironmentFiles, FacesInAFolderAreThoseOfTheCubeMap) {
  const std::string names[] = {"px", "nx", "py", "ny", "pz", "nz"};
  for (const Handedness handedness : kHandednesses) {
    for (const CubeFormat format : kFormats) {
      BakedEnvironment environment = environment_of({32, 16}, telling);
      environment.handedness = handedness;
      if (format == CubeFormat::kRgb9e5) convert_to_rgb9e5(environment);
      if (format == CubeFormat::kRgba32f) convert_to_floats(environment);
      ASSERT_OK(write_face_files(folder_.path("cube"), environment));
      const Ktx2 file = ktx2(environment_of({32, 16}, telling), handedness, format);
      for (size_t level = 0; level < 2; ++level) {
        for (uint32_t face = 0; face < 6; ++face) {
          ASSERT_OK_AND_ASSIGN(
              const auto picture,
              read_image(folder_.path((level == 0 ? "cube/" : "cube/level1/") + names[face] + ".exr")));
          const uint32_t size = 32u >> level;
          ASSERT_EQ(picture.width, size);
          ASSERT_EQ(picture.height, size);
          ASSERT_EQ(picture.format,
                    format == CubeFormat::kRgba32f ? ImageFormat::kRgba32f : ImageFormat::kRgba16f);
          for (uint32_t n = 0; n < size * size; ++n) {
            const Vector texel = file.texel(level, face, n % size, n / size);
            for (int c = 0; c < 3; ++c) ASSERT_EQ(component(picture, n % size, n / size, c), texel[c]);
          }
        }
      }
    }
  }
}

TEST_F(EnvironmentFiles, APathThatCannotBeWrittenLeavesNothingBehind) {
  const BakedEnvironment environment = environment_of({64, 32, 16}, telling);
  const auto message = [](const absl::Status& status) { return std::string(status.message()); };
  const std::string missing = folder_.path("none/a"), reason = ": cannot write: No such file or directory";
  EXPECT_EQ(message(write_ktx2(missing, environment)), missing + reason);
  EXPECT_EQ(message(write_face_files(missing, environment)), missing + reason);
  EXPECT_EQ(message(write_harmonics(missing, environment.harmonics)), missing + reason);
  EXPECT_TRUE(folder_.list().empty());

  write_file(folder_.path("file"), "old");
  EXPECT_EQ(message(write_face_files(folder_.path("file"), environment)),
            folder_.path("file") + ": cannot write: File exists");
  EXPECT_EQ(read_file(folder_.path("file")), "old");

  // A limit on the file size simulates a full disk.
  rlimit old{};
  getrlimit(RLIMIT_FSIZE, &old);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit small = old;
  small.rlim_cur = 4096;
  setrlimit(RLIMIT_FSIZE, &small);
  const absl::Status full = write_ktx2(folder_.path("file"), environment);
  setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(message(full), folder_.path("file") + ": cannot write: File too large");
  EXPECT_EQ(read_file(folder_.path("file")), "old");
  EXPECT_EQ(folder_.list(), std::vector<std::string>{"file"});
}

TEST_F(EnvironmentFiles, AnEnvironmentThatIsNotOneIsRefusedInOneLine) {
  const auto refusal = [&](const std::function<void(BakedEnvironment&)>& damage) {
    BakedEnvironment environment = environment_of({32, 16}, telling);
    damage(environment);
    const absl::Status status = write_ktx2(folder_.path("a.ktx2"), environment);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(status, write_face_files(folder_.path("a"), environment));
    return std::string(status.message());
  };
  EXPECT_EQ(refusal([](BakedEnvironment& e) { e.levels.clear(); }), "the environment has no level");
  EXPECT_EQ(refusal([](BakedEnvironment& e) { e.levels[1].size = 8; }),
            "level 1 of the environment has faces of 8x8 texels; they must be 16x16");
  EXPECT_EQ(refusal([](BakedEnvironment& e) { e.levels[0].size = 0; }),
            "level 0 of the environment has faces of 0x0 texels; they must be at least 1x1");
  EXPECT_EQ(refusal([](BakedEnvironment& e) { e.format = CubeFormat::kRgb9e5; }),
            "level 0 of the environment has 49152 bytes; it needs 24576");
  EXPECT_EQ(refusal([](BakedEnvironment& e) { e.levels[1].roughness = 1.5f; }),
            "level 1 of the environment has roughness 1.5; it must be 0 .. 1");
  EXPECT_EQ(refusal([](BakedEnvironment& e) { e.harmonics[8][2] = NAN; }),
            "a spherical harmonic of the environment is nan; it must be finite");
  EXPECT_TRUE(folder_.list().empty());
}

TEST_F(EnvironmentFiles, HarmonicsAsJsonCarryTheIrradianceOfAWhiteWorld) {
  RadianceHarmonics harmonics{};
  const float constant = static_cast<float>(2 * std::sqrt(std::numbers::pi));  // L_00 of 1 everywhere
  harmonics[0] = {constant, 2 * constant, 0.1f};
  harmonics[3] = {0, 0, 0.3f};
  harmonics[8] = {-1, 0, 0};
  ASSERT_OK(write_harmonics(folder_.path("sh.json"), harmonics));
  const std::string text = read_file(folder_.path("sh.json"));
  const auto json = nlohmann::json::parse(text);
  ASSERT_EQ(json.size(), 2u);
  ASSERT_EQ(json["radiance"].size(), 9u);
  ASSERT_EQ(json["irradiance"].size(), 9u);
  for (size_t i = 0; i < 9; ++i)
    EXPECT_EQ(json["radiance"][i].get<RadianceHarmonics::value_type>(), harmonics[i]);
  EXPECT_NEAR(json["irradiance"][0][0], 11.136656, 2e-6);
  EXPECT_NEAR(json["irradiance"][0][1], 22.273312, 4e-6);
  EXPECT_NEAR(json["irradiance"][3][2], 0.3 * 2 * std::numbers::pi / 3, 1e-6);
  EXPECT_NEAR(json["irradiance"][8][0], -std::numbers::pi / 4, 1e-6);
  harmonics[1][1] = INFINITY;
  EXPECT_EQ(write_harmonics(folder_.path("sh.json"), harmonics).message(),
            "a spherical harmonic of the environment is inf; it must be finite");
  EXPECT_TRUE(says(text, " 0.1\n"));  // a float's digits, not a double's
}

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
