// `candela environment`: cube maps as files. How exact their texels are is tested in tests/device.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <numbers>

#include "absl/strings/str_format.h"
#include "client/image/image.h"
#include "proto/candela/v1/limits.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/baked_environment_support.h"

namespace candela {
namespace {

using Json = nlohmann::json;

// docs/environments.md section 1.
Vector direction(double lon_deg, double lat_deg) {
  const double lon = lon_deg * std::numbers::pi / 180, lat = lat_deg * std::numbers::pi / 180;
  return {std::sin(lon) * std::cos(lat), std::sin(lat), -std::cos(lon) * std::cos(lat)};
}

void write_panorama(const std::string& path, const std::function<Vector(const Vector& d)>& color) {
  constexpr uint32_t kWidth = 256, kHeight = 128;
  ASSERT_OK_AND_ASSIGN(Image image, make_image(kWidth, kHeight, ImageFormat::kRgba16f));
  for (uint32_t i = 0; i < kWidth * kHeight; ++i) {
    const double u = (i % kWidth + 0.5) / kWidth, v = (i / kWidth + 0.5) / kHeight;
    const Vector rgb = color(direction(360 * (u - 0.5), 180 * (0.5 - v)));
    const half texel[4] = {half(static_cast<float>(rgb[0])), half(static_cast<float>(rgb[1])),
                           half(static_cast<float>(rgb[2])), half(1.0f)};
    std::memcpy(image.pixels.data() + i * sizeof texel, texel, sizeof texel);
  }
  ASSERT_OK(write_image(path, image));
}

// R, G and B of a texel of a face, as the file has them.
using FileTexel = std::function<Vector(uint32_t face, uint32_t i, uint32_t j)>;

FileTexel texels_of_ktx2(const std::string& path) {
  return
      [file = parse_ktx2(path)](uint32_t face, uint32_t i, uint32_t j) { return file.texel(0, face, i, j); };
}

FileTexel texels_of_folder(const std::string& path) {
  auto faces = std::make_shared<std::vector<Image>>();
  for (const char* name : {"px", "nx", "py", "ny", "pz", "nz"}) {
    absl::StatusOr<Image> image = read_image(path + "/" + name + ".exr");
    EXPECT_OK(image);
    faces->push_back(image.ok() ? *std::move(image) : Image());
  }
  return [faces](uint32_t face, uint32_t i, uint32_t j) -> Vector {
    const Image& image = faces->at(face);
    half rgba[4];
    std::memcpy(rgba, image.pixels.data() + j * image.row_bytes() + i * sizeof rgba, sizeof rgba);
    return {rgba[0], rgba[1], rgba[2]};
  };
}

// What an engine of that handedness finds in the world's direction d, in faces of size x size.
Vector look(const FileTexel& texel, uint32_t size, Handedness handedness, Vector d) {
  if (handedness == Handedness::kLeft) d[0] = -d[0];
  uint32_t axis = 0;
  for (uint32_t k = 1; k < 3; ++k) {
    if (std::abs(d[k]) > std::abs(d[axis])) axis = k;
  }
  const double most = std::abs(d[axis]);
  const uint32_t face = 2 * axis + (d[axis] < 0 ? 1 : 0);
  uint32_t nearest = 0;
  double distance = 2;
  for (uint32_t i = 0; i < size * size; ++i) {
    const Vector point = cube_point(face, i % size, i / size, size);
    const double away = std::hypot(point[0] - d[0] / most, point[1] - d[1] / most, point[2] - d[2] / most);
    if (away < distance) nearest = i;
    distance = std::min(distance, away);
  }
  return texel(face, nearest % size, nearest / size);
}

class EnvironmentFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(candela({"sample", "--panorama", pano_, "--size", "128x64", "-q"}).code, 0);
  }

  Json bake(const std::string& out, const std::vector<std::string>& options = {}) {
    std::vector<std::string> words = with({"environment", pano_, folder_.path(out), "-q"}, options);
    return candela_json(words);
  }

  Outcome refused(const std::string& out, const std::vector<std::string>& options) {
    const Outcome outcome = candela(with({"environment", pano_, folder_.path(out)}, options));
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    return outcome;
  }

  // The number at byte `at` of a KTX2 file.
  uint32_t word(const std::string& name, size_t at) const {
    const std::string bytes = read_file(folder_.path(name));
    uint32_t value = 0;
    if (bytes.size() >= at + sizeof value) std::memcpy(&value, bytes.data() + at, sizeof value);
    return value;
  }

  std::array<uint32_t, 2> size_of(const std::string& name) const {
    const absl::StatusOr<Image> image = read_image(folder_.path(name));
    EXPECT_OK(image);
    return image.ok() ? std::array{image->width, image->height} : std::array<uint32_t, 2>{};
  }

  const TemporaryFolder folder_;
  const std::string pano_ = folder_.path("pano.exr");
};

TEST_F(EnvironmentFiles, AKtx2HasSixFacesAndAllLevels) {
  const Json json = bake("a.ktx2", {"--size", "64"});
  EXPECT_EQ(json.at("size"), 64);
  ASSERT_EQ(json.at("levels").size(), 3u);
  EXPECT_EQ(json.at("levels")[2].at("size"), 16);
  EXPECT_EQ(json.at("levels")[1].at("roughness"), 0.5);
  EXPECT_EQ(json.at("id").get<std::string>().size(), 64u);
  EXPECT_EQ(json.at("handedness"), "left");
  EXPECT_EQ(read_file(folder_.path("a.ktx2")).substr(1, 6), "KTX 20");
  EXPECT_EQ(word("a.ktx2", 12), 97u);  // VK_FORMAT_R16G16B16A16_SFLOAT
  EXPECT_EQ(word("a.ktx2", 20), 64u);
  EXPECT_EQ(word("a.ktx2", 36), 6u);  // faces
  EXPECT_EQ(word("a.ktx2", 40), 3u);  // levels
}

TEST_F(EnvironmentFiles, TheSizeGoesByThePanoramasWidth) { EXPECT_EQ(bake("a.ktx2").at("size"), 32); }

// A Radiance file of one colour, in runs.
std::string flat_radiance(uint32_t width, uint32_t height) {
  std::string row{2, 2, static_cast<char>(width >> 8), static_cast<char>(width & 255)};
  for (const char component : {'\x64', '\x64', '\x64', '\x81'}) {
    for (uint32_t left = width; left > 0;) {
      const uint32_t run = std::min(left, 127u);
      row += {static_cast<char>(128 + run), component};
      left -= run;
    }
  }
  std::string file = absl::StrFormat("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n", height, width);
  for (uint32_t y = 0; y < height; ++y) file += row;
  return file;
}

TEST_F(EnvironmentFiles, TheBuiltInServerTakesTheLargestPanorama) {
  const std::string largest = folder_.path("largest.hdr");
  write_file(largest, flat_radiance(v1::kMaxPanoramaWidth, v1::kMaxPanoramaWidth / 2));
  const Outcome outcome = candela({"environment", largest, folder_.path("a.ktx2"), "--size", "16", "-q"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
}

TEST_F(EnvironmentFiles, EveryOptionOfTheCubeChangesTheFile) {
  bake("plain.ktx2");
  const std::string plain = read_file(folder_.path("plain.ktx2"));
  for (const std::vector<std::string>& options :
       std::vector<std::vector<std::string>>{{"--size", "64"},
                                             {"--levels", "1"},
                                             {"--handedness", "right"},
                                             {"--rotation", "30"},
                                             {"--format", "rgb9e5"},
                                             {"--primaries", "rec2020"},
                                             {"--tier", "reference"}}) {
    bake("other.ktx2", options);
    EXPECT_TRUE(read_file(folder_.path("other.ktx2")) != plain) << options[0];
  }
  bake("linear.ktx2", {"--size", "64"});
  const Json perceptual = bake("p.ktx2", {"--size", "64", "--roughness-mapping", "perceptual"});
  EXPECT_NEAR(perceptual.at("levels")[1].at("roughness").get<double>(), 0.2928932, 1e-6);
  EXPECT_TRUE(read_file(folder_.path("linear.ktx2")) != read_file(folder_.path("p.ktx2")));
}

TEST_F(EnvironmentFiles, AFolderGetsSixFacesALevel) {
  const Json json = bake("faces/", {"--size", "32"});
  EXPECT_EQ(json.at("layout"), "faces");
  for (const char* face : {"px", "nx", "py", "ny", "pz", "nz"}) {
    EXPECT_EQ(size_of(std::string("faces/") + face + ".exr"), (std::array{32u, 32u}));
    EXPECT_EQ(size_of(std::string("faces/level1/") + face + ".exr"), (std::array{16u, 16u}));
  }
}

TEST_F(EnvironmentFiles, AnExrIsOnePictureALevel) {
  EXPECT_EQ(bake("e.exr").at("layout"), "equirectangular");
  EXPECT_EQ(size_of("e.exr"), (std::array{128u, 64u}));
  const Json cross = bake("c.exr", {"--layout", "cross", "--levels", "2"});
  EXPECT_EQ(cross.at("handedness"), nullptr);
  EXPECT_EQ(size_of("c.exr"), (std::array{128u, 96u}));
  EXPECT_EQ(size_of("c.level1.exr"), (std::array{64u, 48u}));
  EXPECT_EQ(cross.at("files").size(), 2u);
}

// The walls, the sky and the ground of `candela sample --panorama`, whose colours are in
// client/image/scenes.cc.
TEST_F(EnvironmentFiles, TheSamplesWallsAreWhereEnginesLookForThem) {
  constexpr uint32_t kSize = 128;
  const Vector kWhite = {4, 4, 4};
  const Vector kWalls[] = {{0.7, 0.04, 0.03}, {0.05, 0.5, 0.06}, {0.04, 0.08, 0.8}, {0.7, 0.5, 0.02}};
  const ListeningDaemon daemon;
  ASSERT_EQ(candela({"sample", "--panorama", pano_, "--size", "512x256", "-q"}).code, 0);
  for (const Handedness handedness : {Handedness::kLeft, Handedness::kRight}) {
    for (const double rotation : {0.0, 90.0}) {
      for (const bool ktx2 : {true, false}) {
        const std::string out = ktx2 ? "a.ktx2" : "faces/";
        bake(out, {"--size", std::to_string(kSize), "--levels", "1", "--handedness", name(handedness),
                   "--rotation", absl::StrFormat("%g", rotation), "--server", daemon.address()});
        const FileTexel texel =
            ktx2 ? texels_of_ktx2(folder_.path(out)) : texels_of_folder(folder_.path("faces"));
        // +90 moves what was ahead to the left.
        const auto expect = [&](double lon, double lat, const Vector& color) {
          const Vector is = look(texel, kSize, handedness, direction(lon - rotation, lat));
          for (size_t c = 0; c < 3; ++c) {
            EXPECT_NEAR(is[c], color[c], 0.01)
                << out << ", " << name(handedness) << ", " << rotation << ": " << lon << ", " << lat;
          }
        };
        for (int i = 0; i < 4; ++i) {
          expect(90 * i, 8, kWalls[i]);
          expect(90 * i - 10, 12, kWalls[i]);
          expect(90 * i + 10, 12, kWhite);
        }
        expect(0, 90, {0.15, 0.3, 0.8});
        expect(5, -65, {0.088, 0.08, 0.064});
        expect(95, -65, {0.176, 0.16, 0.128});
      }
    }
  }
}

TEST_F(EnvironmentFiles, TheHarmonicsOfAFlatPanoramaAreItsIrradiance) {
  write_panorama(pano_, [](const Vector&) { return Vector{1, 1, 1}; });
  bake("a.ktx2", {"--size", "16", "--sh", folder_.path("a.json")});
  const Json sh = Json::parse(read_file(folder_.path("a.json")), nullptr, false);
  for (size_t i = 0; i < 9; ++i) {
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(sh.at("radiance")[i][c].get<double>(), i == 0 ? 3.5449077 : 0, 1e-5) << i;
      EXPECT_NEAR(sh.at("irradiance")[i][c].get<double>(), i == 0 ? 11.136656 : 0, 1e-5) << i;
    }
  }
}

// Each polynomial of docs/environments.md section 3 is in one colour, so its coefficient tells its place.
TEST_F(EnvironmentFiles, TheHarmonicsAreInTheirOrderAndTurnWithThePanorama) {
  write_panorama(pano_, [](const Vector& d) {
    const auto [x, y, z] = d;
    return Vector{1 + y / 2 + x * y / 4, 1 + z / 2 + y * z / 4 + (3 * z * z - 1) / 8,
                  1 + x / 2 + x * z / 4 + (x * x - y * y) / 8};
  });
  const double l0 = 1 / 0.282095, l1 = 0.5 / 0.488603, l2 = 0.25 / 1.092548;
  const double zz = 0.125 / 0.315392, xx = 0.125 / 0.546274;
  const auto expect = [&](const char* rotation, const std::array<Vector, 9>& radiance) {
    bake("a.ktx2", {"--size", "16", "--levels", "1", "--rotation", rotation, "--sh", folder_.path("a.json")});
    const Json sh = Json::parse(read_file(folder_.path("a.json")), nullptr, false);
    const double kLobe[] = {std::numbers::pi, 2 * std::numbers::pi / 3, std::numbers::pi / 4};
    for (size_t i = 0; i < 9; ++i) {
      const double lobe = kLobe[i == 0 ? 0 : i < 4 ? 1 : 2];
      for (size_t c = 0; c < 3; ++c) {
        EXPECT_NEAR(sh.at("radiance")[i][c].get<double>(), radiance[i][c], 1e-3) << rotation << ": " << i;
        EXPECT_NEAR(sh.at("irradiance")[i][c].get<double>(), lobe * radiance[i][c], 3e-3)
            << rotation << ": " << i;
      }
    }
  };
  expect("0", {{{l0, l0, l0},
                {l1, 0, 0},
                {0, l1, 0},
                {0, 0, l1},
                {l2, 0, 0},
                {0, l2, 0},
                {0, zz, 0},
                {0, 0, l2},
                {0, 0, xx}}});
  // x becomes -z, and z becomes x. 3 x^2 - 1 is 3/2 (x^2 - y^2) - 1/2 (3 z^2 - 1), and z^2 - y^2 is half the
  // sum of the two.
  expect("90", {{{l0, l0, l0},
                 {l1, 0, 0},
                 {0, 0, -l1},
                 {0, l1, 0},
                 {0, l2, 0},
                 {-l2, 0, 0},
                 {0, -zz / 2, zz / 2},
                 {0, 0, -l2},
                 {0, 1.5 * xx, xx / 2}}});
}

TEST_F(EnvironmentFiles, WhatRgb9e5DoesNotHoldIsCounted) {
  write_panorama(pano_, [](const Vector&) { return Vector{-1, 65504, 0.5}; });
  const uint64_t texels = 6 * (32 * 32 + 16 * 16);
  const Json packed = bake("a.ktx2", {"--size", "32", "--format", "rgb9e5"});
  EXPECT_EQ(packed.at("losses"), (Json{{"negative", texels}, {"clamped", texels}}));
  EXPECT_TRUE(says(packed.at("notes").dump(), absl::StrFormat("%d negative components became 0", texels)))
      << packed;
  const Json halves = bake("b.ktx2", {"--size", "32"});
  EXPECT_EQ(halves.at("losses"), (Json{{"negative", 0}, {"clamped", 0}}));
  EXPECT_EQ(halves.at("notes").size(), 0u) << halves;
}

TEST_F(EnvironmentFiles, HarmonicsAndPreviewAreWrittenBeside) {
  const Json json = bake("a.ktx2", {"--sh", folder_.path("a.json"), "--preview", folder_.path("a.png")});
  const Json sh = Json::parse(read_file(folder_.path("a.json")), nullptr, false);
  ASSERT_EQ(sh.at("radiance").size(), 9u);
  EXPECT_GT(sh.at("irradiance")[0][2].get<double>(), 0);
  const PngFacts facts = png_facts(folder_.path("a.png"));
  EXPECT_EQ(facts.width, 16u + 128 + 16 + 64 + 16);
  EXPECT_EQ(facts.height, 16u + 96 + 16);
  EXPECT_TRUE(json.at("stage_ms").contains("preview"));
}

TEST_F(EnvironmentFiles, ADaemonGivesTheBytesThatTheServerInsideGives) {
  const ListeningDaemon daemon;
  bake("here.ktx2");
  EXPECT_EQ(bake("there.ktx2", {"--server", daemon.address()}).at("had_it"), false);
  EXPECT_EQ(bake("again.ktx2", {"--server", daemon.address()}).at("had_it"), true);
  EXPECT_TRUE(read_file(folder_.path("here.ktx2")) == read_file(folder_.path("there.ktx2")));
  EXPECT_TRUE(read_file(folder_.path("here.ktx2")) == read_file(folder_.path("again.ktx2")));
}

TEST_F(EnvironmentFiles, WrongUseNamesTheOptionAndWritesNothing) {
  const std::pair<std::vector<std::string>, const char*> wrong[] = {
      {{"--size", "48"}, "power of two"},    {{"--size", "8192"}, "--size"},
      {{"--levels", "9"}, "down to 16x16"},  {{"--layout", "cross"}, "--layout cross"},
      {{"--format", "bc6h"}, "rgb9e5"},      {{"--handedness", "both"}, "left, right"},
      {{"--sh", "a.txt"}, "--sh"},           {{"--preview", "a.jpg"}, "--preview"},
      {{"--tier", "finest"}, "unknown tier"}};
  for (const auto& [options, words] : wrong) {
    const Outcome outcome = refused("a.ktx2", options);
    EXPECT_TRUE(says(outcome.err, words));
  }
  EXPECT_FALSE(std::filesystem::exists(folder_.path("a.ktx2")));
  EXPECT_TRUE(says(refused("a.dds", {}).err, ".ktx2"));
  EXPECT_TRUE(says(refused("pano.exr", {}).err, "is the input"));
}

TEST_F(EnvironmentFiles, HandednessOfAPictureIsNoted) {
  const Outcome outcome = candela({"environment", pano_, folder_.path("e.exr"), "--handedness", "right"});
  EXPECT_EQ(outcome.code, 0);
  EXPECT_TRUE(says(outcome.err, "--handedness changes nothing"));
}

}  // namespace
}  // namespace candela
