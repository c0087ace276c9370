// Images of another size than their frames: --resize, --max-size and --desqueeze.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfInputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/cli/stream_fixture.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Json = nlohmann::json;
using Options = std::vector<std::string>;

class Resize : public StreamFixture {
 protected:
  void SetUp() override {
    ASSERT_EQ(candela({"sample", scene_, "--size", "64x48", "-q"}).code, 0);
    write_small_exr(wide_, /*alpha_and_aspect=*/true);
  }

  Json render(const std::string& in, const Options& options, const std::string& name = "out.png") {
    return candela_json(with({"render", in, path(name), "-q"}, options));
  }
  // The bytes of the scene that is rendered with these options.
  std::string picture(const Options& options, const std::string& name = "out.png") {
    render(scene_, options, name);
    return read_file(path(name));
  }
  std::string path(const std::string& name) const { return folder_.path(name); }

  const std::string scene_ = folder_.path("scene.exr");
  const std::string wide_ = folder_.path("wide.exr");  // 31x17 pixels of the aspect 2
};

std::pair<uint32_t, uint32_t> size_of(const std::string& path) {
  const PngFacts facts = png_facts(path);
  return {facts.width, facts.height};
}

TEST_F(Resize, TheSameSizeInOtherWordsIsTheSameImage) {
  const std::string half = picture({"--resize", "32x24"});
  EXPECT_EQ(size_of(path("out.png")), std::pair(32u, 24u));
  for (const char* size : {"32x", "x24", "50%", "32X24"}) {
    EXPECT_TRUE(picture({"--resize", size}) == half) << size;
  }
  EXPECT_TRUE(picture({"--max-size", "32"}) == half);
  EXPECT_TRUE(picture({"--resize", "32x24", "--resize", "50%"}) == half);
  EXPECT_FALSE(picture({}) == half);
}

TEST_F(Resize, APictureThatIsSmallEnoughKeepsItsBits) {
  for (const char* name : {"a.png", "a.jpg", "a.exr", "a.tif", "a.pfm"}) {
    const std::string before = picture({}, name);
    for (const Options& options :
         {Options{"--max-size", "64"}, {"--max-size", "16384"}, {"--resize", "100%"}}) {
      EXPECT_TRUE(picture(options, name) == before) << name << " " << options.back();
    }
    EXPECT_FALSE(picture({"--max-size", "63"}, name) == before) << name;
  }
}

TEST_F(Resize, EveryKindOfFileHasTheSizeAndTheReportHasBoth) {
  for (const char* name : {"a.png", "a.jpg", "a.exr", "a.tif", "a.pfm"}) {
    const Json json = render(scene_, {"--resize", "20x"}, name);
    EXPECT_EQ(json["size"]["width"], 20) << name;
    EXPECT_EQ(json["size"]["height"], 15) << name;
    EXPECT_EQ(json["frame_size"]["width"], 64) << name;
    EXPECT_EQ(json["frame_size"]["height"], 48) << name;
  }
  for (const char* name : {"a.exr", "a.pfm"}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(path(name)));
    EXPECT_EQ(image.width, 20u);
    EXPECT_EQ(image.height, 15u);
  }
  const Outcome line = candela({"render", scene_, path("a.png"), "--resize", "200%"});
  EXPECT_TRUE(says(line.out, "a.png: 128x96 of 64x48; ")) << line.err;
  EXPECT_TRUE(says(candela({"render", scene_, path("a.png"), "-v", "--max-size", "8"}).out, "8x6 of 64x48"));
  EXPECT_TRUE(says(candela({"render", scene_, path("a.png")}).out, "a.png: 64x48; "));
}

TEST_F(Resize, AThumbnailIsExposedAsItsFrame) {
  const Json frame = render(scene_, {}), thumbnail = render(scene_, {"--max-size", "5"});
  EXPECT_EQ(frame["exposure"], thumbnail["exposure"]);
  EXPECT_EQ(frame["mean_log2_luminance"], thumbnail["mean_log2_luminance"]);
}

TEST_F(Resize, AFolderOfPicturesGetsSmallOnes) {
  const Outcome outcome =
      candela({"render", scene_, wide_, path("out/"), "--max-size", "16", "-q", "--json", "-"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(size_of(path("out/scene.png")), std::pair(16u, 12u));
  EXPECT_EQ(size_of(path("out/wide.png")), std::pair(16u, 9u));
}

// A file's pixels keep their aspect, unless the size that is asked for has another shape.
TEST_F(Resize, AnamorphicPixelsAreMadeSquareOnDemand) {
  struct Case {
    Options options;
    std::pair<uint32_t, uint32_t> size;
    double aspect;
  };
  for (const Case& c :
       {Case{{"--resize", "200%"}, {62, 34}, 2}, Case{{"--resize", "62x"}, {62, 34}, 2},
        Case{{"--resize", "62x17"}, {62, 17}, 1}, Case{{"--resize", "31x34"}, {31, 34}, 4},
        Case{{"--desqueeze"}, {62, 17}, 1}, Case{{"--desqueeze", "--resize", "200%"}, {124, 34}, 1},
        Case{{"--desqueeze", "--resize", "x34"}, {124, 34}, 1},
        Case{{"--desqueeze", "--max-size", "31"}, {31, 9}, 1}}) {
    SCOPED_TRACE(::testing::PrintToString(c.options));
    const Json json = render(wide_, c.options);
    EXPECT_EQ(size_of(path("out.png")), c.size);
    EXPECT_NEAR(png_facts(path("out.png")).pixel_aspect, c.aspect, 1e-3);
    const bool squared = c.options.front() == "--desqueeze";
    EXPECT_EQ(says(json["notes"].dump(), "--desqueeze made square pixels of the file's, whose aspect is 2"),
              squared);
    const bool reshaped = c.options.back() == "62x17" || c.options.back() == "31x34";
    EXPECT_EQ(says(json["notes"].dump(), "changes the shape of 31x17"), reshaped);
    // OpenEXR names it, too.
    render(wide_, c.options, "out.exr");
    ASSERT_OK_AND_ASSIGN(const Image image, read_image(path("out.exr")));
    EXPECT_EQ(std::pair(image.width, image.height), c.size);
    EXPECT_NEAR(image.pixel_aspect, c.aspect, 1e-6);
  }
  const std::string before = picture({});
  EXPECT_TRUE(picture({"--desqueeze"}) == before);
  EXPECT_TRUE(says(render(scene_, {"--desqueeze"})["notes"].dump(), "the file's pixels are square"));
}

TEST_F(Resize, AnOpenExrFileKeepsNoAttributeOfPixelsThatItHasNoMore) {
  Imf::Header header(Imath::Box2i({5, 6}, {68, 53}), Imath::Box2i({5, 6}, {68, 53}));
  header.insert("ascFramingDecisionList", Imf::StringAttribute("{}"));
  header.insert("owner", Imf::StringAttribute("me"));
  Imf::addXDensity(header, 72);
  for (const char* name : {"R", "G", "B"}) header.channels().insert(name, Imf::Channel(Imf::HALF));
  {
    const std::vector<half> row(64, half(0.5f));
    Imf::FrameBuffer frame;
    for (const char* name : {"R", "G", "B"}) {
      char* base = const_cast<char*>(reinterpret_cast<const char*>(row.data())) - 5 * sizeof(half);
      frame.insert(name, Imf::Slice(Imf::HALF, base, sizeof(half), 0));
    }
    Imf::OutputFile file(path("in.exr").c_str(), header);
    file.setFrameBuffer(frame);
    file.writePixels(48);
  }
  for (const bool resized : {false, true}) {
    render(path("in.exr"), resized ? Options{"--max-size", "32"} : Options{}, "out.exr");
    const Imf::InputFile file(path("out.exr").c_str());
    const Imf::Header& out = file.header();
    const Imath::Box2i window = resized ? Imath::Box2i({0, 0}, {31, 23}) : Imath::Box2i({5, 6}, {68, 53});
    EXPECT_EQ(out.displayWindow(), window);
    EXPECT_EQ(out.dataWindow(), window);
    EXPECT_EQ(Imf::xDensity(out), resized ? 36 : 72);
    EXPECT_EQ(out.findTypedAttribute<Imf::StringAttribute>("ascFramingDecisionList") != nullptr, !resized);
    EXPECT_NE(out.findTypedAttribute<Imf::StringAttribute>("owner"), nullptr);
  }
}

// The display window is resized, whatever part of it or beyond it the file stores.
TEST_F(Resize, TheDisplayWindowIsResized) {
  // A picture of 24x16, of which only x 4..27 and y 2..9 have pixels, in two files.
  const Imath::Box2i display({0, 0}, {23, 15}), data({4, 2}, {27, 9});
  const auto texel = [](int x, int y) { return half(0.05f * static_cast<float>(1 + (x * 5 + y * 3) % 11)); };
  const auto write = [&](const std::string& name, const Imath::Box2i& window) {
    Imf::Header header(display, window);
    const int width = window.max.x - window.min.x + 1, height = window.max.y - window.min.y + 1;
    std::vector<half> pixels;
    for (int y = window.min.y; y <= window.max.y; ++y) {
      for (int x = window.min.x; x <= window.max.x; ++x) {
        const half light = data.intersects(Imath::V2i(x, y)) ? texel(x, y) : half(0.0f);
        pixels.insert(pixels.end(), {light, half(data.intersects(Imath::V2i(x, y)) ? 1.0f : 0.0f)});
      }
    }
    const size_t stride = 2 * sizeof(half), row = stride * static_cast<size_t>(width);
    char* base = reinterpret_cast<char*>(pixels.data()) - window.min.x * static_cast<ptrdiff_t>(stride) -
                 window.min.y * static_cast<ptrdiff_t>(row);
    Imf::FrameBuffer frame;
    for (const char* channel : {"R", "G", "B", "A"}) {
      header.channels().insert(channel, Imf::Channel(Imf::HALF));
      frame.insert(channel, Imf::Slice(Imf::HALF, base + (*channel == 'A' ? sizeof(half) : 0), stride, row));
    }
    Imf::OutputFile file(path(name).c_str(), header);
    file.setFrameBuffer(frame);
    file.writePixels(height);
  };
  write("windows.exr", data);
  write("whole.exr", display);
  for (const char* size : {"12x8", "7x", "300%"}) {
    for (const char* out : {"a.png", "a.exr", "a.jpg"}) {
      render(path("windows.exr"), {"--resize", size, "--exposure", "0"}, out);
      const std::string windows = read_file(path(out));
      render(path("whole.exr"), {"--resize", size, "--exposure", "0"}, out);
      EXPECT_TRUE(read_file(path(out)) == windows) << size << " " << out;
    }
  }
}

TEST_F(Resize, AResizedImageIsVerified) {
  const Json json = render(scene_, {"--resize", "30x20", "--verify", "--error-map", path("map.png")});
  EXPECT_LT(json["verify"]["max_error_codes"], 0.5);
  EXPECT_GT(size_of(path("map.png")).second, 20u);  // with its legend
  EXPECT_LT(size_of(path("map.png")).second, 48u);
}

TEST_F(Resize, FramesOfASequenceAreResizedAndHeldFramesAreAsLarge) {
  make_frames(4);
  std::filesystem::remove(in() + "/0002.exr");
  const std::vector<Json> lines = stream({"--resize", "50%", "--missing", "hold"});
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_EQ(lines[0]["width"], 32);
  EXPECT_EQ(lines[0]["frame_width"], 64);
  EXPECT_EQ(lines[2]["held"], true);
  EXPECT_TRUE(image("0002.png") == image("0001.png"));
  EXPECT_EQ(size_of(path("out/0002.png")), std::pair(32u, 24u));
  // The server's files have the same size. A part of the sequence has the images of the whole.
  stream({"--resize", "50%", "--missing", "hold", "--encoding", "png"}, "server");
  EXPECT_EQ(size_of(path("server/0003.png")), std::pair(32u, 24u));
  stream({"--resize", "50%", "--missing", "hold", "--exposure", "0"}, "all");
  stream({"--resize", "50%", "--missing", "hold", "--exposure", "0", "--range", "2-3"}, "part");
  EXPECT_TRUE(image("0002.png", "part") == image("0002.png", "all"));
}

TEST_F(Resize, EachFrameOfASequenceHasItsOwnSize) {
  make_frames(2);
  ASSERT_EQ(candela({"sample", path("in/0002.exr"), "--size", "32x32", "-q"}).code, 0);
  write_small_exr(path("in/0003.exr"), /*alpha_and_aspect=*/true);
  const Outcome outcome =
      candela({"stream", in(), path("out"), "-q", "--json", "-", "--max-size", "16", "--desqueeze"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_EQ(size_of(path("out/0001.png")), std::pair(16u, 12u));
  EXPECT_EQ(size_of(path("out/0002.png")), std::pair(16u, 16u));
  EXPECT_EQ(size_of(path("out/0003.png")), std::pair(16u, 4u));
  EXPECT_EQ(png_facts(path("out/0003.png")).pixel_aspect, 1);
  // A y4m has one size.
  const Outcome film = candela({"stream", in(), "-", "-q", "--max-size", "16"});
  EXPECT_EQ(film.code, 3);
  EXPECT_TRUE(
      says(film.err,
           "0002.exr: its image is 16x16, and a y4m has frames of one size, here 16x12; --resize 16x12"));
  const Outcome same = candela({"stream", in(), "-", "-q", "--resize", "16x12"});
  EXPECT_EQ(same.code, 0) << same.err;
  EXPECT_EQ(same.out.substr(0, 17), "YUV4MPEG2 W16 H12");
  EXPECT_EQ(same.out.size(), same.out.find('\n') + 1 + 4 * (6 + 16 * 12 * 3 / 2));
}

TEST_F(Resize, AViewIsDrawnLargeAndWrittenSmall) {
  ASSERT_EQ(candela({"sample", "--panorama", path("pano.exr"), "--size", "128x64", "-q"}).code, 0);
  const Json json = candela_json({"view", path("pano.exr"), path("v.png"), "--size", "96x64", "--objects",
                                  "lookdev", "--resize", "25%", "-q"});
  EXPECT_EQ(size_of(path("v.png")), std::pair(24u, 16u));
  EXPECT_EQ(json["frame_size"]["width"], 96);
  const Outcome turn = candela({"view", path("pano.exr"), path("turn"), "--size", "96x64", "--turn", "90",
                                "--frames", "2", "--max-size", "24", "-q", "--json", "-"});
  EXPECT_EQ(turn.code, 0) << turn.err;
  EXPECT_EQ(size_of(path("turn/0001.png")), std::pair(24u, 16u));
  EXPECT_TRUE(says(candela({"view", path("pano.exr"), path("v.png"), "--desqueeze"}).err, "--desqueeze"));
}

TEST_F(Resize, AWrongSizeIsRefusedWithWhatIsAllowed) {
  const auto refused = [this](const Options& options, const std::string& words) {
    const Outcome outcome = candela(with({"render", scene_, path("no.png")}, options));
    EXPECT_EQ(outcome.code, 2) << outcome.err;
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
    EXPECT_FALSE(std::filesystem::exists(path("no.png")));
  };
  for (const char* size : {"480", "x", "0x10", "10x0", "16385x", "x16385", "10x20x30", "-5x5", "0%", "-1%",
                           "1001%", "nan%", "%", "axb", "1.5x2", "half"}) {
    refused({"--resize", size},
            absl::StrFormat("--resize is \"%s\"; it must be WIDTHxHEIGHT, WIDTHx or xHEIGHT", size));
  }
  for (const char* size : {"0", "16385", "1.5", "10x10", "50%"})
    refused({"--max-size", size}, "--max-size is ");
  refused({"--max-size", "10", "--resize", "50%"}, "--resize and --max-size both say the image's size");
  // By the frame's shape a side would be more than an image may have.
  const Outcome large = candela({"render", scene_, path("no.png"), "--resize", "x16384"});
  EXPECT_EQ(large.code, 3) << large.err;
  EXPECT_TRUE(says(large.err, "--resize makes an image of 21845x16384 pixels of a frame of 64x48"));
  EXPECT_EQ(candela({"meter", scene_, "--resize", "50%"}).code, 2);
}

}  // namespace
}  // namespace candela
