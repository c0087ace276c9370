// The files that `candela render` and `candela sample` write.
#include <gtest/gtest.h>
#include <half.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_split.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/baked_environment_support.h"

namespace candela {
namespace {

class Render : public ::testing::Test {
 protected:
  void SetUp() override { write_small_exr(in_); }

  // The bytes of the picture that is rendered with these additional options.
  std::string picture(std::vector<std::string> options, const std::string& name = "out.png") {
    options.insert(options.begin(), {"render", in_, folder_.path(name), "-q"});
    const Outcome outcome = candela(options);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    return read_file(folder_.path(name));
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
};

TEST_F(Render, TheSampleSceneBecomesAPngOfItsSize) {
  const std::string scene = folder_.path("scene.exr"), png = folder_.path("scene.png");
  ASSERT_EQ(candela({"sample", scene, "--size", "321x179"}).code, 0);
  const Outcome outcome = candela({"render", scene, png, "-v"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const PngFacts facts = png_facts(png);
  EXPECT_EQ(facts.width, 321u);
  EXPECT_EQ(facts.height, 179u);
  EXPECT_EQ(facts.bits, 8);
  EXPECT_FALSE(facts.alpha);
  for (const char* word : {"321x179", "EV", "ingest", "resolve", " ms", "scene.png"}) {
    EXPECT_TRUE(says(outcome.out, word));
  }
}

TEST_F(Render, TheSampleSceneIsTheSameEveryTimeInBothFormats) {
  for (const char* name : {"a.pfm", "b.pfm", "c.exr", "d.exr"}) {
    ASSERT_EQ(candela({"sample", folder_.path(name), "--size", "33x21", "-q"}).code, 0) << name;
  }
  EXPECT_TRUE(read_file(folder_.path("a.pfm")) == read_file(folder_.path("b.pfm")));
  EXPECT_TRUE(read_file(folder_.path("c.exr")) == read_file(folder_.path("d.exr")));
}

TEST_F(Render, TwoRunsGiveTheSameBits) { EXPECT_TRUE(picture({}, "a.png") == picture({}, "b.png")); }

TEST_F(Render, EveryKindOfOutputIsWritten) {
  picture({"--bits", "16"}, "deep.png");
  EXPECT_EQ(png_facts(folder_.path("deep.png")).bits, 16);
  EXPECT_EQ(picture({}, "a.jpg").substr(0, 2), "\xff\xd8");
  EXPECT_LT(picture({"--quality", "5"}, "small.jpeg").size(),
            picture({"--quality", "95"}, "large.jpg").size());
  const std::string tiff("II*\0", 4);
  EXPECT_EQ(picture({}, "a.tif").substr(0, 4), tiff);
  EXPECT_EQ(picture({"--bits", "16"}, "deep.tiff").substr(0, 4), tiff);
  for (const char* name : {"a.exr", "a.pfm"}) {
    picture({}, name);
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(folder_.path(name)));
    EXPECT_EQ(image.width, 31u);
    EXPECT_EQ(image.height, 17u);
  }
}

TEST_F(Render, AlphaAndPixelAspectReachPngAndExr) {
  write_small_exr(in_, true);
  for (const char* bits : {"8", "16"}) {
    picture({"--bits", bits}, "out.png");
    EXPECT_TRUE(png_facts(folder_.path("out.png")).alpha);
    EXPECT_NEAR(png_facts(folder_.path("out.png")).pixel_aspect, 2, 1e-3);
  }
  picture({}, "out.exr");
  ASSERT_OK_AND_ASSIGN(const Image image, read_image(folder_.path("out.exr")));
  EXPECT_TRUE(image.has_alpha);
  EXPECT_EQ(image.pixel_aspect, 2);
  const absl::StatusOr<Image> input = read_image(in_);
  for (size_t i = 6; i < image.bytes(); i += 8) {  // the alpha half
    ASSERT_EQ(image.pixels.data()[i], input->pixels.data()[i]);
    ASSERT_EQ(image.pixels.data()[i + 1], input->pixels.data()[i + 1]);
  }
}

TEST_F(Render, EveryOptionChangesThePicture) {
  const std::string plain = picture({});
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {"--exposure", "-2"},
           {"--compensation", "1"},
           {"--key", "0.5"},
           {"--min-exposure", "50"},
           {"--max-exposure", "0.1"},
           {"--bloom-intensity", "1"},
           {"--bloom-threshold", "0.1"},
           {"--bloom-softness", "0", "--bloom-threshold", "0.5", "--bloom-intensity", "1"},
           {"--bloom-levels", "1", "--bloom-intensity", "1"},
           {"--bloom-firefly", "off", "--bloom-intensity", "1"},
           {"--curve", "linear"},
           {"--curve", "reinhard"},
           {"--curve", "aces-narkowicz"},
           {"--prescale", "0.5"},
           {"--transfer", "gamma22"},
           {"--transfer", "linear"}}) {
    EXPECT_TRUE(picture(options) != plain) << ::testing::PrintToString(options);
  }
}

TEST_F(Render, TheDefaultsSpeltOutChangeNothing) {
  const std::string spelt_out =
      "--exposure auto --compensation 0 --key 0.18 --min-exposure 0.015625 --max-exposure 64 "
      "--bloom-intensity 0.05 --bloom-threshold 1 --bloom-softness 0.5 --bloom-levels 5 --bloom-firefly on "
      "--curve aces-hill --prescale 1 --transfer srgb --tier standard --bad-values scrub --bits 8";
  EXPECT_TRUE(picture(absl::StrSplit(spelt_out, ' ')) == picture({}));
}

TEST_F(Render, TheLastOfARepeatedOptionCounts) {
  const std::string repeated =
      picture({"--curve", "linear", "--exposure", "3", "--curve", "reinhard", "--exposure=auto"});
  EXPECT_TRUE(repeated == picture({"--curve", "reinhard"}));
}

#ifndef CANDELA_SANITIZED  // a sanitizer's own memory counts too
TEST_F(Render, AFrameOf4KHalvesStaysUnder600MB) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
  constexpr int64_t kLimitKib = 600'000'000 / 1024;
  const std::string frame = data_folder() + "/exr/large_4096x3112.exr";
  for (const std::vector<std::string>& output :
       std::vector<std::vector<std::string>>{{"a.png"}, {"b.png", "--bits", "16"}, {"c.exr"}}) {
    std::vector<std::string> arguments{"render", frame, folder_.path(output[0])};
    arguments.insert(arguments.end(), output.begin() + 1, output.end());
    // Memory varies with the machine's load, because it depends on how many threads work at the same time. So
    // this takes the smallest of three.
    int64_t least_kib = std::numeric_limits<int64_t>::max();
    for (int i = 0; i < 3 && least_kib >= kLimitKib; ++i) {
      const Outcome outcome = candela(arguments);
      EXPECT_EQ(outcome.code, 0) << outcome.err;
      least_kib = std::min<int64_t>(least_kib, outcome.peak_kib);
    }
    EXPECT_LT(least_kib, kLimitKib) << output[0];
  }
}
#endif

// Outputs that are inputs: every command refuses them under every name, before any work, and leaves nothing.

class Outputs : public ::testing::Test {
 protected:
  void SetUp() override {
    write_small_exr(in_);
    for (const char* name : {"file.txt", "token", "shot.json"}) write_file(folder_.path(name), "kept");
  }

  // All names of one file: as it is, by another spelling, by links, and through a folder that is not there.
  std::vector<std::string> names_of(const std::string& name) const {
    const std::string path = folder_.path(name);
    const std::string soft = folder_.path("soft_" + name), hard = folder_.path("hard_" + name);
    (void)symlink(path.c_str(), soft.c_str());
    (void)::link(path.c_str(), hard.c_str());
    return {path, folder_.path("./" + name), soft, hard, folder_.path("none/../" + name)};
  }

  void expect_refused(const std::vector<std::string>& arguments) const {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    const std::vector<std::string> before = folder_.list();
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(outcome.err.find("to another file") != std::string::npos ||
                outcome.err.find("would be one file") != std::string::npos)
        << outcome.err;
    EXPECT_EQ(folder_.list(), before);
  }

  const TemporaryFolder folder_;
  const std::string in_ = folder_.path("in.exr");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(Outputs, FilesOfTheServersOptionsAreInputsOfEveryCommand) {
  const std::string folder = folder_.path("out");
  const std::vector<std::vector<std::string>> commands = {{"render", in_, out_},
                                                          {"stream", in_, folder},
                                                          {"meter", in_},
                                                          {"info", in_},
                                                          {"bench"},
                                                          {"view", in_, out_},
                                                          {"environment", in_, folder_.path("sky.ktx2")}};
  for (const std::string& json : names_of("token")) {
    for (const std::vector<std::string>& command : commands) {
      for (const char* option : {"--token-file", "--tls-ca", "--tls-cert", "--tls-key"}) {
        std::vector<std::string> arguments = command;
        arguments.insert(arguments.end(),
                         {"--server", "127.0.0.1:1", option, folder_.path("token"), "--json", json});
        expect_refused(arguments);
      }
    }
  }
  write_file(folder_.path("report.json"), "kept");
  expect_refused(
      {"report", folder_.path("."), "--server", "127.0.0.1:1", "--token-file", folder_.path("report.json")});
  EXPECT_EQ(read_file(folder_.path("token")), "kept");
  EXPECT_EQ(read_file(folder_.path("report.json")), "kept");
}

TEST_F(Outputs, EveryOutputOfASequenceIsHeldAgainstItsInputs) {
  for (const char* option : {"--json", "--save-exposures"}) {
    for (const std::string& input : names_of("in.exr")) {
      expect_refused({"stream", in_, folder_.path("out"), option, input});
      expect_refused({"meter", folder_.path("*.exr"), option, input});
    }
  }
  for (const std::string& same : names_of("file.txt")) {
    expect_refused({"stream", in_, folder_.path("out"), "--ocio", folder_.path("file.txt"), "--json", same});
    expect_refused({"render", in_, out_, "--ocio", folder_.path("file.txt"), "--json", same});
    expect_refused({"render", in_, out_, "--locked-exposure", folder_.path("file.txt"), "--json", same});
    expect_refused(
        {"stream", in_, folder_.path("out"), "--save-exposures", folder_.path("file.txt"), "--json", same});
  }
  expect_refused({"stream", in_, folder_.path("%04d.exr"), "--save-exposures", folder_.path("0000.exr")});
  const std::string plot = folder_.path("plot.svg");  // the name has to end so
  for (const auto link_as : {&symlink, &::link}) {
    ASSERT_EQ(link_as(in_.c_str(), plot.c_str()), 0);
    expect_refused({"stream", in_, folder_.path("out"), "--exposure-plot", plot});
    expect_refused({"meter", in_, "--exposure-plot", plot});
    expect_refused(
        {"view", in_, folder_.path("%04d.png"), "--turn", "90", "--frames", "2", "--exposure-plot", plot});
    ASSERT_EQ(unlink(plot.c_str()), 0);
  }
}

TEST_F(Outputs, OfAViewAreHeldAgainstItsInputs) {
  write_file(folder_.path("keys.json"),
             R"({"keys": [{"time": 0, "yaw": 0, "fov": 60}, {"time": 1, "yaw": 90, "fov": 60}]})");
  write_file(folder_.path("spheres.json"), R"({"objects": [{"centre": [0, 0, -3], "radius": 1}]})");
  const std::string frames = folder_.path("frames/%04d.png");
  for (const std::string& same : names_of("in.exr")) {
    expect_refused({"view", in_, same});
    expect_refused({"view", same, in_});
    expect_refused({"view", in_, out_, "--json", same});
    expect_refused({"view", in_, frames, "--turn", "90", "--frames", "2", "--json", same});
  }
  for (const auto& [option, name] : std::vector<std::pair<std::string, std::string>>{
           {"--objects", "spheres.json"}, {"--ocio", "file.txt"}, {"--locked-exposure", "shot.json"}}) {
    for (const std::string& same : names_of(name)) {
      expect_refused({"view", in_, out_, option, folder_.path(name), "--json", same});
      expect_refused(
          {"view", in_, frames, "--turn", "90", "--frames", "2", option, folder_.path(name), "--json", same});
    }
  }
  for (const std::string& same : names_of("keys.json")) {
    expect_refused(
        {"view", in_, frames, "--path", folder_.path("keys.json"), "--frames", "2", "--json", same});
  }
  for (const auto link_as : {&symlink, &::link}) {
    ASSERT_EQ(link_as(in_.c_str(), out_.c_str()), 0);
    expect_refused({"view", in_, out_});
    expect_refused({"view", in_, folder_.path("other.png"), "--error-map", out_});
    ASSERT_EQ(unlink(out_.c_str()), 0);
    ASSERT_EQ(link_as(in_.c_str(), folder_.path("0001.png").c_str()), 0);
    expect_refused({"view", in_, folder_.path("%04d.png"), "--turn", "90", "--frames", "2"});
    ASSERT_EQ(unlink(folder_.path("0001.png").c_str()), 0);
  }
}

TEST_F(Outputs, OfAnEnvironmentAreHeldAgainstItsInputs) {
  const std::string sky = folder_.path("sky.ktx2");
  for (const std::string& same : names_of("in.exr")) {
    expect_refused({"environment", in_, same});
    expect_refused({"environment", same, in_});
    expect_refused({"environment", in_, sky, "--json", same});
  }
  // Outputs whose names have to end in something else.
  const std::string map = folder_.path("link.ktx2"), sh = folder_.path("sh.json"),
                    preview = folder_.path("preview.png"), faces = folder_.path("faces/");
  std::filesystem::create_directories(faces + "level1");
  const std::vector<std::pair<std::string, std::vector<std::string>>> links = {
      {map, {"environment", in_, map}},
      {sh, {"environment", in_, sky, "--sh", sh}},
      {preview, {"environment", in_, sky, "--preview", preview}},
      {folder_.path("cube.level1.exr"), {"environment", in_, folder_.path("cube.exr"), "--levels", "2"}},
      {faces + "nz.exr", {"environment", in_, faces}},
      {faces + "level1/px.exr", {"environment", in_, faces}}};
  for (const auto link_as : {&symlink, &::link}) {
    for (const auto& [link, arguments] : links) {
      ASSERT_EQ(link_as(in_.c_str(), link.c_str()), 0);
      expect_refused(arguments);
      ASSERT_EQ(unlink(link.c_str()), 0);
    }
  }
}

// The folder of a file to save is made only once the command is found to be right.
TEST_F(Outputs, NothingIsMadeForACommandThatIsRefused) {
  expect_refused({"stream", in_, folder_.path("out"), "--save-exposures", folder_.path("new/saved.json"),
                  "--json", in_});
  const std::vector<std::string> made = folder_.list();
  EXPECT_FALSE(std::count(made.begin(), made.end(), "new"));
}

TEST_F(Outputs, ACommandThatFailsRemovesTheFoldersThatItMade) {
  write_file(folder_.path("damaged.exr"), "v/1\1");
  const std::string image = folder_.path("new/deep/out.png");
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"render", folder_.path("damaged.exr"), image},
        {"view", folder_.path("damaged.exr"), image},
        {"environment", folder_.path("damaged.exr"), folder_.path("new/deep/")}}) {
    const std::vector<std::string> before = folder_.list();
    EXPECT_EQ(candela(arguments).code, 3);
    EXPECT_EQ(folder_.list(), before);
  }
  ASSERT_TRUE(std::filesystem::create_directory(folder_.path("new")));
  EXPECT_EQ(candela({"render", folder_.path("damaged.exr"), image}).code, 3);
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path("new")));
}

TEST_F(Outputs, FieldsOfTheContractAreNamedAsOptions) {
  struct Case {
    std::vector<std::string> arguments;
    int code;
    std::string words;
  };
  const std::string folder = folder_.path("out");
  for (const auto& [arguments, code, words] : std::vector<Case>{
           {{"render", in_, out_, "--spot", "900,0,910,10"}, 2, in_ + ": --spot begins at x 900"},
           {{"render", in_, out_, "--spot", "4,4,4,8"}, 2, "--spot is x 4 .. 4"},
           {{"meter", in_, "--spot", "900,0,910,10"}, 2, "--spot begins at x 900"},
           {{"stream", in_, folder, "--spot", "900,0,910,10"}, 2, "--spot begins at x 900"},
           {{"stream", in_, folder, "--session", "a/b"}, 2, "--session has 3 bytes"},
           {{"stream", in_, folder, "--encoding", "jpeg", "--alpha", "straight"}, 2, "--alpha is STRAIGHT"},
           {{"render", in_, out_, "--primaries", "0.3,0.3,0.3,0.3,0.1,0.1,0.3,0.3"},
            2,
            "--primaries (0.3"}}) {
    SCOPED_TRACE(::testing::PrintToString(arguments));
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
  }
}

// PNG and JPEG files that the server makes are those that the command makes: pixels, alpha and pixel aspect.

class Encoded : public ::testing::Test {
 protected:
  // Streams the folder "in" twice: encoded by the command, and by the server.
  void expect_the_same(const std::string& encoding, std::vector<std::string> options) {
    const std::string own = folder_.path("own"), made = folder_.path("made");
    const std::string name = encoding == "png" ? "/%04d.png" : "/%04d.jpg";
    options.insert(options.begin(), {"stream", folder_.path("in"), own + name, "-q"});
    ASSERT_EQ(candela(options).code, 0);
    options[2] = made + name;
    options.insert(options.end(), {"--encoding", encoding});
    ASSERT_EQ(candela(options).code, 0);
    const std::string file = encoding == "png" ? "/0000.png" : "/0000.jpg";
    EXPECT_FALSE(read_file(own + file).empty());
    EXPECT_TRUE(read_file(own + file) == read_file(made + file)) << encoding;
    if (encoding == "png") facts_ = png_facts(made + file);
  }

  // An image with this alpha everywhere, lit or black, and pixels twice as wide as high.
  void write_flat(float alpha, bool lit) {
    ASSERT_OK_AND_ASSIGN(Image image, make_image(24, 16, ImageFormat::kRgba32f));
    auto* component = reinterpret_cast<float*>(image.pixels.data());
    for (uint32_t i = 0; i < 24 * 16; ++i, component += 4) {
      for (int k = 0; k < 3; ++k) component[k] = lit ? 0.1f * static_cast<float>(k + 1) : 0;
      component[3] = alpha;
    }
    image.has_alpha = true;
    image.pixel_aspect = 2;
    ASSERT_EQ(candela({"sample", folder_.path("in/x.exr"), "--size", "8x8", "-q"}).code, 0);  // the folder
    std::filesystem::remove(folder_.path("in/x.exr"));
    ASSERT_OK(write_image(folder_.path("in/0000.exr"), image));
  }

  const TemporaryFolder folder_;
  PngFacts facts_;
};

TEST_F(Encoded, PixelAspectAndAlphaAreTheSame) {
  ASSERT_EQ(candela({"sample", folder_.path("in/x.exr"), "--size", "8x8", "-q"}).code, 0);
  std::filesystem::remove(folder_.path("in/x.exr"));
  write_small_exr(folder_.path("in/0000.exr"), true);
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {}, {"--bits", "16"}, {"--alpha", "associated"}, {"--transfer", "gamma22"}}) {
    expect_the_same("png", options);
    EXPECT_TRUE(facts_.alpha);
    EXPECT_NEAR(facts_.pixel_aspect, 2, 1e-3);
  }
  expect_the_same("png", {"--alpha", "over"});
  EXPECT_FALSE(facts_.alpha);
  expect_the_same("jpeg", {});
  expect_the_same("jpeg", {"--quality", "50"});
}

TEST_F(Encoded, AConstantAlphaIsKeptUnlessItSaysNothing) {
  write_flat(0.5f, true);
  expect_the_same("png", {"--alpha", "associated"});
  EXPECT_TRUE(facts_.alpha);
  write_flat(0, true);
  expect_the_same("png", {"--alpha", "associated"});
  EXPECT_FALSE(facts_.alpha);
  write_flat(0, false);
  expect_the_same("png", {"--alpha", "associated"});
  EXPECT_TRUE(facts_.alpha);
}

// Which way round environments are, from the file of a panorama to the files of its cube map and to its
// views.

constexpr uint32_t kPanoWidth = 256, kPanoHeight = 128, kSide = 32;

// The direction of a texel (docs/environments.md section 1), as a point of the cube.
Vector panorama_point(uint32_t x, uint32_t y) {
  const double lon = 2 * std::numbers::pi * ((x + 0.5) / kPanoWidth - 0.5);
  const double lat = std::numbers::pi * (0.5 - (y + 0.5) / kPanoHeight);
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
    ASSERT_OK_AND_ASSIGN(Image image, make_image(kPanoWidth, kPanoHeight, ImageFormat::kRgba16f));
    std::byte* out = image.pixels.data();
    for (uint32_t y = 0; y < kPanoHeight; ++y) {
      for (uint32_t x = 0; x < kPanoWidth; ++x) {
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
