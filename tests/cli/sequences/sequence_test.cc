// The numbers of a sequence's frames, from the names of the files to the names of the images: gaps, ranges,
// cuts and rates of `candela stream`.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/cli/sequences/stream_fixture.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Json = nlohmann::json;

class SequenceOfFrames : public StreamFixture {
 protected:
  // frame.0001.exr to frame.0005.exr without frame.0004.exr.
  void make_gap() {
    ASSERT_EQ(
        candela({"sample", "--sequence", folder_.path("all"), "--frames", "6", "--size", "64x48", "-q"}).code,
        0);
    std::filesystem::create_directory(in());
    for (const char* number : {"0001", "0002", "0003", "0005"}) {
      std::filesystem::rename(folder_.path("all/") + number + ".exr", in() + "/frame." + number + ".exr");
    }
  }
  std::string pattern() const { return in() + "/frame.%04d.exr"; }

  // An image of 8 x 8 with the attribute framesPerSecond.
  static void write_exr_of_rate(const std::string& path, FrameRate rate) {
    Image image = *make_image(8, 8, ImageFormat::kRgba16f);
    image.frame_rate = rate;
    ASSERT_OK(write_image(path, image));
  }
};

TEST_F(SequenceOfFrames, AMissingFrameIsNamedBeforeAnythingIsRendered) {
  make_gap();
  const Outcome outcome = candela({"stream", pattern(), folder_.path("out/%04d.png")});
  EXPECT_EQ(outcome.code, 3);
  EXPECT_EQ(outcome.err,
            "candela: error: " + pattern() +
                ": frame 4 is missing; --missing skip renders the others, --missing hold repeats "
                "the frame before\n");
  EXPECT_FALSE(std::filesystem::exists(folder_.path("out")));
}

TEST_F(SequenceOfFrames, SkippedFramesKeepTheNumbersAndTheTimeOfTheOthers) {
  make_gap();
  const Outcome outcome = candela({"stream", pattern(), folder_.path("out/%04d.png"), "--missing", "skip",
                                   "--fps", "10", "--json", folder_.path("json")});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "frame 4 is missing; skipped"));
  EXPECT_TRUE(says(outcome.out, "10 fps, from --fps"));
  EXPECT_EQ(names_in(folder_.path("out")),
            (std::vector<std::string>{"0001.png", "0002.png", "0003.png", "0005.png"}));
  const std::vector<Json> lines = lines_of(read_file(folder_.path("json")));
  ASSERT_EQ(lines.size(), 5u);
  const double before = lines[2].at("exposure"), target = lines[3].at("target");
  EXPECT_EQ(lines[3].at("frame"), 5);
  EXPECT_EQ(lines[3].at("media_time_ns"), 400'000'000);
  const double alpha = 1 - std::exp(-0.2 * (target > before ? 3 : 1));
  EXPECT_NEAR(std::log2(lines[3].at("exposure").get<double>()),
              std::log2(before) + (std::log2(target) - std::log2(before)) * alpha, 1e-9)
      << "two frames of time have passed";
  const Json& summary = lines[4].at("summary");
  EXPECT_EQ(summary.at("first"), 1);
  EXPECT_EQ(summary.at("last"), 5);
  EXPECT_EQ(summary.at("missing"), "4");
  EXPECT_EQ(summary.at("written"), 4);
}

TEST_F(SequenceOfFrames, AHeldFrameHasTheBytesOfTheOneBeforeAndChangesNoOther) {
  make_gap();
  for (const std::vector<std::string>& options :
       std::vector<std::vector<std::string>>{{"--dither"}, {"--encoding", "png"}}) {
    stream(with({"--missing", "skip"}, options), "skip");
    const std::vector<Json> lines = stream(with({"--missing", "hold"}, options), "hold");
    EXPECT_EQ(names_in(folder_.path("hold")),
              (std::vector<std::string>{"frame.0001.png", "frame.0002.png", "frame.0003.png",
                                        "frame.0004.png", "frame.0005.png"}));
    EXPECT_TRUE(image("frame.0004.png", "hold") == image("frame.0003.png", "hold"));
    for (const char* name : {"frame.0001.png", "frame.0003.png", "frame.0005.png"}) {
      EXPECT_TRUE(image(name, "hold") == image(name, "skip")) << name;
    }
    ASSERT_EQ(lines.size(), 6u);
    EXPECT_EQ(lines[3].at("held"), true);
    EXPECT_EQ(lines[3].at("frame"), 4);
    EXPECT_EQ(lines[3].at("input"), in() + "/frame.0003.exr");
    EXPECT_EQ(lines[5].at("summary").at("held"), 1);
    EXPECT_EQ(lines[5].at("summary").at("written"), 4);
  }
}

TEST_F(SequenceOfFrames, AFrameThatCannotBeReadIsHeldAndSoAreTheOnesAfterIt) {
  make_gap();
  write_file(in() + "/frame.0003.exr", "no image at all");
  const std::vector<Json> lines = lines_of(
      candela({"stream", in(), folder_.path("out"), "--missing", "hold", "--skip-bad", "--json", "-"}).out);
  ASSERT_EQ(lines.size(), 6u);
  EXPECT_EQ(lines[2].at("held"), true);
  EXPECT_TRUE(says(lines[2].at("error").get<std::string>(), "frame.0003.exr"));
  for (const size_t held : {2, 3}) {
    EXPECT_EQ(lines[held].at("input"), in() + "/frame.0002.exr");
    EXPECT_TRUE(read_file(lines[held].at("output")) == image("frame.0002.png"));
  }
  EXPECT_EQ(names_in(folder_.path("out")),
            (std::vector<std::string>{"frame.0001.png", "frame.0002.png", "frame.0003.png", "frame.0004.png",
                                      "frame.0005.png"}));
}

TEST_F(SequenceOfFrames, ImagesHaveTheNumbersOrTheNamesOfTheirFrames) {
  make_gap();
  const std::string range = "1-5x2";
  for (const auto& [out, third] :
       std::vector<std::pair<std::string, std::string>>{{"a/%04d.png", "a/0003.png"},
                                                        {"b/x.####.png", "b/x.0003.png"},
                                                        {"c/@@.png", "c/03.png"},
                                                        {"d/#.exr", "d/3.exr"},
                                                        {"e", "e/frame.0003.png"}}) {
    const std::vector<Json> lines = stream({"--range", range}, out);
    ASSERT_EQ(lines.size(), 4u);
    EXPECT_EQ(lines[1].at("output"), folder_.path(third));
    EXPECT_TRUE(std::filesystem::exists(folder_.path(third))) << third;
  }
  EXPECT_EQ(stream({"--range", range, "--first", "10"}, "f/%d.png")[2].at("output"),
            folder_.path("f/12.png"));
  const Outcome first = candela({"stream", in(), folder_.path("g"), "--range", "1-3", "--first", "10"});
  EXPECT_TRUE(says(first.err, "--first changes nothing"));
}

TEST_F(SequenceOfFrames, ARangeRendersTheBitsThatTheWholeRenders) {
  make_frames(8);
  stream({"--exposure", "0", "--dither"}, "whole");
  const std::vector<Json> lines = stream({"--exposure", "0", "--dither", "--range", "4-7x3"}, "part");
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0].at("media_time_ns"), 166'666'667) << "time counts from frame 0";
  EXPECT_EQ(names_in(folder_.path("part")), (std::vector<std::string>{"0004.png", "0007.png"}));
  for (const char* name : {"0004.png", "0007.png"})
    EXPECT_TRUE(image(name, "part") == image(name, "whole")) << name;
}

TEST_F(SequenceOfFrames, ACutGivenByItsNumberIsTaken) {
  make_frames(8);
  const std::vector<Json> uncut = stream({}), lines = stream({"--cut-at", "2,5"});
  ASSERT_EQ(lines.size(), 9u);
  for (size_t i = 1; i < 8; ++i) EXPECT_EQ(lines[i].at("cut"), i == 2 || i == 5) << i;
  EXPECT_NE(uncut[5].at("exposure"), uncut[5].at("target"));
  EXPECT_EQ(lines[5].at("exposure"), lines[5].at("target"));
}

TEST_F(SequenceOfFrames, TheRateIsTheFilesUnlessItIsGiven) {
  std::filesystem::create_directory(in());
  write_exr_of_rate(in() + "/1.exr", {24000, 1001});
  write_exr_of_rate(in() + "/2.exr", {24000, 1001});
  write_exr_of_rate(in() + "/3.exr", {25, 1});
  const auto time = [this](const std::vector<std::string>& options) {
    const std::vector<Json> lines = stream(options);
    return std::pair(lines.at(2).at("media_time_ns").get<int64_t>(), lines.at(3).at("summary"));
  };
  const auto [of_file, summary] = time({});
  EXPECT_EQ(of_file, 83'416'667);
  EXPECT_EQ(summary.at("fps"), "24000/1001");
  EXPECT_EQ(summary.at("fps_from"), "file");
  EXPECT_EQ(time({"--fps", "30000/1001"}).first, 66'733'333);
  stream({}, "exr/%d.exr");
  EXPECT_EQ(read_image(folder_.path("exr/3.exr"))->frame_rate, (FrameRate{24000, 1001})) << "images carry it";
  const Outcome said = candela({"stream", in(), folder_.path("out")});
  EXPECT_TRUE(says(said.out, "24000/1001 fps, from the file"));
  EXPECT_TRUE(says(said.err, "3.exr says 25 fps; all frames are shown at 24000/1001 fps"));
}

TEST_F(SequenceOfFrames, StillsThatAreNoSequenceAreRenderedWithANote) {
  std::filesystem::create_directory(in());
  write_small_exr(in() + "/house.exr");
  ASSERT_EQ(candela({"sample", in() + "/tree2.exr", "--size", "40x30", "-q"}).code, 0);
  const Outcome outcome = candela({"stream", in(), folder_.path("out")});
  EXPECT_EQ(outcome.code, 0);
  EXPECT_TRUE(says(outcome.err, "their names have no number in common"));
  EXPECT_TRUE(says(outcome.err, "house.exr is 31x17, and " + in() + "/tree2.exr 40x30"));
  EXPECT_EQ(names_in(folder_.path("out")), (std::vector<std::string>{"house.png", "tree2.png"}));
}

TEST_F(SequenceOfFrames, AnOutputThatIsAPipeOrLooksLikeAnOptionIsRefused) {
  make_frames(2);
  const std::string frame = in() + "/0000.exr";
  for (const std::vector<std::string>& arguments : std::vector<std::vector<std::string>>{
           {"view", frame, "-"}, {"sample", "-"}, {"sample", "--sequence", "-"}}) {
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, 2);
    EXPECT_TRUE(says(outcome.err, "cannot be written to a pipe"));
  }
  const Outcome option = candela({"sample", "--sequence", "-out"});
  EXPECT_EQ(option.code, 2);
  EXPECT_TRUE(says(option.err, "write ./-out if it is a name"));
  // After -- a word is a path, whatever it begins with.
  const Outcome path = candela({"render", frame, "--", "-out.gif"});
  EXPECT_EQ(path.code, 2);
  EXPECT_TRUE(says(path.err, "./-out.gif: images are not written as '.gif'"));
  for (const char* command : {"render", "stream"}) {
    const Outcome made = candela({command, frame, in() + "/0001.exr", "--", folder_.path("--files")});
    EXPECT_EQ(made.code, 0) << made.err;
    EXPECT_EQ(names_in(folder_.path("--files")), (std::vector<std::string>{"0000.png", "0001.png"}));
  }
}

}  // namespace
}  // namespace candela
