// `candela environment`: cube maps as files. What their texels are is tested in tests/unit and tests/device.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>

#include "absl/strings/str_format.h"
#include "client/image/image.h"
#include "proto/candela/v1/limits.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"

namespace candela {
namespace {

using Json = nlohmann::json;

class EnvironmentFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(candela({"sample", "--panorama", pano_, "--size", "128x64", "-q"}).code, 0);
  }

  Json bake(const std::string& out, const std::vector<std::string>& options = {}) {
    std::vector<std::string> words{"environment", pano_, folder_.path(out), "-q"};
    words.insert(words.end(), options.begin(), options.end());
    return candela_json(words);
  }

  Outcome refused(const std::string& out, const std::vector<std::string>& options) {
    std::vector<std::string> words{"environment", pano_, folder_.path(out)};
    words.insert(words.end(), options.begin(), options.end());
    const Outcome outcome = candela(words);
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
    EXPECT_TRUE(image.ok()) << image.status();
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
    EXPECT_NE(outcome.err.find(words), std::string::npos) << outcome.err;
  }
  EXPECT_FALSE(std::filesystem::exists(folder_.path("a.ktx2")));
  EXPECT_NE(refused("a.dds", {}).err.find(".ktx2"), std::string::npos);
  EXPECT_NE(refused("pano.exr", {}).err.find("is the input"), std::string::npos);
}

TEST_F(EnvironmentFiles, HandednessOfAPictureIsNoted) {
  const Outcome outcome = candela({"environment", pano_, folder_.path("e.exr"), "--handedness", "right"});
  EXPECT_EQ(outcome.code, 0);
  EXPECT_NE(outcome.err.find("--handedness changes nothing"), std::string::npos) << outcome.err;
}

}  // namespace
}  // namespace candela
