// The numbers of a sequence's frames, from the names of the files to the names of the images: gaps, ranges,
// cuts and rates of `candela stream`.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfDoubleAttribute.h>
#include <OpenEXR/ImfFloatAttribute.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIntAttribute.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfRationalAttribute.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfVecAttribute.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <memory>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/cli/stream_fixture.h"
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

// `candela render` of many images into a folder.

class Folder : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(mkdir(folder_.path("in").c_str(), 0700), 0);
    for (const char* name : {"b2.exr", "b10.exr", "a.exr"}) write_small_exr(in(name), name[0] == 'a');
  }
  std::string in(const std::string& name) const { return folder_.path("in/" + name); }
  std::string out(const std::string& name) const { return folder_.path("out/new/" + name); }
  // Pictures that the command may replace.
  static constexpr const char* kOldPictures[] = {"a.png", "b2.png", "scene.exr"};
  void write_old_pictures() const {
    std::filesystem::create_directories(folder_.path("out/new"));
    for (const char* name : kOldPictures) write_file(out(name), "old");
  }
  // Each file is whole, or as write_old_pictures() made it. If the command ended with 0, `written` is not.
  void expect_whole_pictures(int code, const std::string& written, int signal = SIGINT) const {
    EXPECT_TRUE(code == 128 + signal || (code == 0 && read_file(written) != "old")) << code;
    for (const auto& file : std::filesystem::directory_iterator(folder_.path("out/new"))) {
      SCOPED_TRACE(file.path());
      const std::string bytes = read_file(file.path());
      if (bytes == "old") continue;
      if (file.path().extension() == ".exr") {
        EXPECT_OK(read_image(file.path()));
      } else {
        EXPECT_EQ(file.path().extension(), ".png");
        EXPECT_EQ(bytes.substr(0, 4), "\x89PNG");
        EXPECT_EQ(bytes.substr(std::max<size_t>(bytes.size(), 8) - 8, 4), "IEND");
      }
    }
    for (const char* name : kOldPictures) {
      EXPECT_TRUE(std::filesystem::exists(out(name))) << name;
    }
  }
  // The lines of JSON on stdout.
  static std::vector<nlohmann::json> lines(const Outcome& outcome) {
    std::vector<nlohmann::json> all;
    for (absl::string_view line : absl::StrSplit(outcome.out, '\n', absl::SkipEmpty())) {
      all.push_back(nlohmann::json::parse(line, nullptr, false));
    }
    return all;
  }

  const TemporaryFolder folder_;
};

TEST_F(Folder, EveryImageIsTheOneThatItIsAlone) {
  const Outcome outcome = candela({"render", in("b10.exr"), in("a.exr"), in("b2.exr"), out("")});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  for (const char* name : {"a", "b2", "b10"}) {
    const std::string alone = folder_.path("alone.png"), input = in(name) + ".exr";
    ASSERT_EQ(candela({"render", input, alone, "-q"}).code, 0);
    EXPECT_TRUE(read_file(alone) == read_file(out(name) + ".png")) << name;
  }
  // The lines are in the order of the inputs.
  const std::vector<std::string> text = absl::StrSplit(outcome.out, '\n', absl::SkipEmpty());
  ASSERT_EQ(text.size(), 4u) << outcome.out;
  EXPECT_EQ(text[0].find(in("b10.exr") + " -> "), 0u) << text[0];
  EXPECT_EQ(text[1].find(in("a.exr") + " -> "), 0u) << text[1];
  EXPECT_EQ(text[3].find("3 of 3 images -> "), 0u) << text[3];
}

TEST_F(Folder, APatternAndAFolderAreTakenInNaturalOrder) {
  for (const std::string& input : {in("*.exr"), folder_.path("in")}) {
    const Outcome outcome = candela({"render", input, out(""), "--as", "exr", "--json", "-"});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const std::vector<nlohmann::json> all = lines(outcome);
    ASSERT_EQ(all.size(), 4u) << outcome.out;
    for (size_t i = 0; i < 3; ++i) {
      const std::string name = std::vector<std::string>{"a", "b2", "b10"}[i];
      EXPECT_EQ(all[i].at("input"), in(name + ".exr"));
      EXPECT_EQ(all[i].at("output"), out(name + ".exr"));
      EXPECT_EQ(all[i].at("size").at("width"), 31);
      EXPECT_OK(read_image(out(name + ".exr")));
    }
    EXPECT_EQ(all[3].at("summary").at("images"), 3);
    EXPECT_EQ(all[3].at("summary").at("written"), 3);
    EXPECT_EQ(all[3].at("summary").at("failed"), 0);
  }
}

TEST_F(Folder, OneImageKeepsItsNameInAFolder) {
  EXPECT_EQ(candela({"render", in("a.exr"), out(""), "-q"}).code, 0);
  EXPECT_EQ(png_facts(out("a.png")).width, 31u);
  EXPECT_EQ(candela({"render", in("b2.exr"), folder_.path("out/new"), "-q", "--as", "jpg"}).code, 0);
  EXPECT_EQ(read_file(out("b2.jpg")).substr(0, 2), "\xff\xd8");
}

TEST_F(Folder, OneFailureDoesNotStopTheRest) {
  write_file(in("b1.exr"), "no image");
  const Outcome outcome = candela({"render", in("*.exr"), in("missing.exr"), out(""), "--json", "-"});
  EXPECT_EQ(outcome.code, 3);
  const std::vector<std::string> errors = absl::StrSplit(outcome.err, '\n', absl::SkipEmpty());
  const auto is_error = [&](const std::string& words) {
    return std::ranges::any_of(errors, [&](const std::string& line) {
      return line.find("candela: error: ") == 0 && line.find(words) != std::string::npos;
    });
  };
  EXPECT_TRUE(is_error(in("b1.exr") + ": not an OpenEXR")) << outcome.err;
  EXPECT_TRUE(is_error(in("missing.exr") + ": cannot read")) << outcome.err;
  EXPECT_EQ(errors.back(), "candela: error: 2 of 5 images failed");
  for (const char* name : {"a.png", "b2.png", "b10.png"}) EXPECT_EQ(png_facts(out(name)).width, 31u) << name;
  const std::vector<nlohmann::json> all = lines(outcome);
  ASSERT_EQ(all.size(), 6u) << outcome.out;
  EXPECT_TRUE(says(all[1].at("error").get<std::string>(), "not an OpenEXR"));
  EXPECT_EQ(all[5].at("summary").at("failed"), 2);
}

TEST_F(Folder, TwoImagesOfOneNameAreRefusedBeforeAnythingIsRendered) {
  ASSERT_EQ(candela({"sample", in("a.pfm"), "--size", "8x8", "-q"}).code, 0);
  const Outcome outcome = candela({"render", in("b2.exr"), in("a.exr"), in("a.pfm"), out("")});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_TRUE(says(outcome.err, "a.exr and " + in("a.pfm") + " would both become " + out("a.png")));
  struct stat about {};
  EXPECT_NE(stat(out("").c_str(), &about), 0);
}

TEST_F(Folder, EveryFormatIsRenderedAndOtherFilesAreCounted) {
  ASSERT_EQ(candela({"render", in("a.exr"), in("c.png"), "-q"}).code, 0);
  ASSERT_EQ(candela({"render", in("a.exr"), in("d.JPG"), "-q"}).code, 0);
  write_file(in("notes.txt"), "");
  const Outcome all = candela({"render", in(""), out("")});
  EXPECT_EQ(all.code, 0) << all.err;
  EXPECT_TRUE(says(all.out, "5 of 5 images")) << all.out;
  EXPECT_TRUE(says(all.err, "left out: 1 file of another kind (" + in("notes.txt") + ")")) << all.err;
  const Outcome some = candela({"render", in(""), out(""), "--only", "png,jpg"});
  EXPECT_TRUE(says(some.out, "2 of 2 images")) << some.out;
  EXPECT_TRUE(says(some.err, "left out: 4 files of other kinds (" + in("a.exr") + " ...)")) << some.err;
}

// What a run wrote beside its inputs is nobody's input.
TEST_F(Folder, OutputsAreNeverReadAgain) {
  ASSERT_EQ(candela({"render", in(""), in("out/"), "-q"}).code, 0);
  EXPECT_TRUE(says(candela({"render", in(""), in("out/")}).out, "3 of 3 images"));
  ASSERT_EQ(candela({"render", in(""), in(""), "-q"}).code, 0);
  const Outcome again = candela({"render", in(""), in("")});
  EXPECT_EQ(again.code, 2);
  EXPECT_TRUE(says(again.err, in("a.exr") + " and " + in("a.png") + " would both become " + in("a.png") +
                                  "; --only exr takes the first"))
      << again.err;
  EXPECT_TRUE(says(candela({"render", in(""), in(""), "--only", "exr"}).out, "3 of 3 images"));
  for (int run = 0; run < 2; ++run) {
    const Outcome sheet = candela({"contact", in(""), in("sheet.jpg"), "--only", "exr,jpg"});
    EXPECT_TRUE(says(sheet.out, "3 of 3 images")) << sheet.out << sheet.err;
  }
  ASSERT_EQ(candela({"stream", in("b#.exr"), in("%04d.png"), "-q", "--missing", "skip"}).code, 0);
  const Outcome mixed = candela({"stream", in(""), in("%04d.png")});
  EXPECT_EQ(mixed.code, 3);
  EXPECT_TRUE(says(mixed.err, "a sequence is of one format; --only ")) << mixed.err;
  const std::string film = folder_.path("film");
  ASSERT_EQ(candela({"sample", "--sequence", film, "--frames", "2", "--size", "8x8", "-q"}).code, 0);
  const std::vector<std::string> beside = {"stream", film, film + "/out_%04d.exr", "-q", "--first", "90"};
  ASSERT_EQ(candela(beside).code, 0);
  const Outcome again_beside = candela(beside);
  EXPECT_EQ(again_beside.code, 2);
  EXPECT_TRUE(says(again_beside.err, "out_0090.exr looks like an image of OUT")) << again_beside.err;
}

TEST_F(Folder, InfoDescribesFoldersPatternsAndStandardInput) {
  write_file(in("notes.txt"), "");
  const Outcome folder = candela({"info", in(""), "--json", "-"});
  EXPECT_EQ(folder.code, 0) << folder.err;
  EXPECT_TRUE(says(folder.err, "left out: 1 file of another kind"));
  const std::vector<nlohmann::json> all = lines(folder);
  ASSERT_EQ(all.size(), 3u) << folder.out;
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(all[i].at("file"), in(std::vector<std::string>{"a.exr", "b2.exr", "b10.exr"}[i]));
  }
  EXPECT_EQ(lines(candela({"info", in("b*.exr"), "--json", "-"})).size(), 2u);
  const Outcome piped = candela_in_shell("exec <" + in("a.exr"), {"info", "-", "--json", "-"});
  EXPECT_EQ(piped.code, 0) << piped.err;
  nlohmann::json file = all[0];
  file["file"] = "-";
  EXPECT_EQ(lines(piped), std::vector<nlohmann::json>{file});
  EXPECT_EQ(candela_in_shell("exec <" + in("notes.txt"), {"info", "-"}).code, 3);
  EXPECT_EQ(candela({"info", "-", in("a.exr")}).code, 2);
}

TEST_F(Folder, AServerThatIsNotThereIsOneError) {
  const Outcome outcome =
      candela({"render", in("*.exr"), out(""), "--server", "unix:" + folder_.path("none")});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "cannot reach"));
}

TEST_F(Folder, ASignalLeavesNoPartOfAFile) {
  for (const char* name : {"c1.exr", "c2.exr", "c3.exr", "c4.exr"}) {
    ASSERT_EQ(candela({"sample", in(name), "--size", "900x600", "-q"}).code, 0);
  }
  for (const int ms : {150, 300, 450, 600}) {
    SCOPED_TRACE(ms);
    write_old_pictures();
    const Outcome outcome = candela_with_signal({"render", in("*.exr"), out(""), "-q"}, SIGINT, ms);
    expect_whole_pictures(outcome.code, out("a.png"));
  }
}

#ifndef CANDELA_SANITIZED  // a sanitizer wants to be loaded first
TEST_F(Folder, ASignalWhileAFileIsMadeLeavesNoPartOfIt) {
  // More images than writers, so that a writer begins another while the process ends.
  for (int i = 0; i < 8; ++i) write_small_exr(in("c" + std::to_string(i) + ".exr"), false);
  const std::string signal = std::to_string(SIGINT);
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{"render", in("*.exr"), out(""), "-q"},
                                             {"render", in("a.exr"), out("a.png"), "-q"},
                                             {"sample", out("scene.exr"), "-q"}}) {
    for (const char* variable : {"CANDELA_TEST_SIGNAL", "CANDELA_TEST_FIRST_PROCESS"}) {
      SCOPED_TRACE(arguments[0] + " " + variable);
      write_old_pictures();
      const Outcome outcome = candela_on_failing_machine(variable, signal.c_str(), arguments);
      EXPECT_EQ(outcome.err, "");
      expect_whole_pictures(outcome.code, out(arguments[0] == "sample" ? "scene.exr" : "a.png"));
    }
  }
  for (const int each : {SIGTERM, SIGHUP, SIGQUIT, SIGABRT, SIGALRM, SIGUSR1, SIGUSR2, SIGXCPU}) {
    SCOPED_TRACE(each);
    write_old_pictures();
    const Outcome outcome = candela_on_failing_machine("CANDELA_TEST_SIGNAL", std::to_string(each).c_str(),
                                                       {"render", in("a.exr"), out("a.png"), "-q"});
    EXPECT_EQ(outcome.err, "");
    expect_whole_pictures(outcome.code, out("a.png"), each);
  }
}
#endif

TEST_F(Folder, FoldersOfOutputsAreMade) {
  const std::string json_file = folder_.path("x/y/z.json"), map = folder_.path("maps/m/map.png");
  ASSERT_EQ(
      candela({"render", in("a.exr"), folder_.path("p/q/a.png"), "--json", json_file, "--error-map", map})
          .code,
      0);
  EXPECT_EQ(png_facts(folder_.path("p/q/a.png")).width, 31u);
  EXPECT_TRUE(nlohmann::json::parse(read_file(json_file), nullptr, false).is_object());
  EXPECT_GT(png_facts(map).width, 0u);
  EXPECT_EQ(candela({"sample", folder_.path("s/t/scene.exr"), "--size", "8x8", "-q"}).code, 0);
  EXPECT_OK(read_image(folder_.path("s/t/scene.exr")));
}

// Sequences as people have them: numbers below 0, files of other systems in the folder, parts whose ends are
// missing, frame rates as other programs write them. Field tests use the shared test data.

using Options = std::vector<std::string>;
using Numbers = std::vector<int64_t>;

class FieldFrames : public StreamFixture {
 protected:
  // The lines of `candela stream`'s JSON; the last one is the summary. Nothing if it failed.
  std::vector<Json> stream(const std::string& input, const std::string& output, const Options& options) {
    const Outcome outcome = candela(with({"stream", input, output, "--json", path("lines.json")}, options));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    told_ = outcome.err;
    return lines_of(read_file(path("lines.json")));
  }

  // The same for names in the folder.
  std::vector<Json> stream_in(const std::string& output, const Options& options) {
    return stream(path("in"), path(output), options);
  }

  static Numbers frames_of(const std::vector<Json>& lines) {
    Numbers numbers;
    for (const Json& line : lines) {
      if (line.contains("frame")) numbers.push_back(line.at("frame"));
    }
    return numbers;
  }

  // Frames of 64 x 48 whose light varies with their numbers, as in/f.-002.exr.
  void make_frames(const Numbers& numbers) const {
    std::filesystem::create_directories(path("in"));
    for (const int64_t number : numbers) {
      Image image = *make_image(64, 48, ImageFormat::kRgba32f);
      const float light = std::exp2(2 * std::sin(static_cast<float>(number)));
      for (size_t at = 0; at < size_t{64} * 48; ++at) {
        const float grey = light * (0.1f + static_cast<float>(at % 64) / 64);
        const float pixel[] = {grey, 0.8f * grey, 0.5f * grey, 1};
        std::memcpy(image.pixels.data() + at * sizeof pixel, pixel, sizeof pixel);
      }
      ASSERT_OK(write_image(frame(number), image));
    }
  }
  std::string frame(int64_t number) const { return path(absl::StrFormat("in/f.%04d.exr", number)); }

  std::string path(const std::string& name) const { return folder_.path(name); }
  // Whether both folders hold the same image of this number.
  bool same(const std::string& whole, const std::string& part, int64_t number) const {
    const std::string name = absl::StrFormat("/%04d.png", number);
    const std::string expected = read_file(path(whole) + name);
    return !expected.empty() && read_file(path(part) + name) == expected;
  }

  std::string told_;  // stderr of the last stream
};

class FieldSequence : public FieldFrames {
 protected:
  void SetUp() override {
    if (data_folder().empty() || !std::filesystem::exists(data("S01_negative"))) {
      GTEST_SKIP() << "no test data: set CANDELA_DATA to its folder";
    }
  }
  static std::string data(const std::string& name) { return data_folder() + "/field/" + name; }
};

TEST_F(FieldSequence, NegativeFramesPlayInTheirOrderByEveryInput) {
  const std::string s01 = data("S01_negative");
  for (const std::string& input :
       {s01, s01 + "/*.exr", s01 + "/test_frame.%04d.exr", s01 + "/test_frame.####.exr",
        s01 + "/test_frame.@@@@.exr", s01 + "/test_frame.%d.exr"}) {
    const std::vector<Json> lines = stream(input, path("out/%04d.png"), {"--fps", "10"});
    EXPECT_EQ(frames_of(lines), (Numbers{-10, -9, -8, -7, -6, -5})) << input;
    ASSERT_EQ(lines.size(), 7u);
    EXPECT_EQ(lines[0].at("input"), s01 + "/test_frame.-010.exr");
    EXPECT_EQ(lines[0].at("output"), path("out/-010.png"));
    EXPECT_EQ(lines[0].at("media_time_ns"), 0);
    EXPECT_EQ(lines[5].at("media_time_ns"), 500'000'000);
    EXPECT_EQ(lines[6].at("summary").at("first"), -10);
    EXPECT_EQ(lines[6].at("summary").at("last"), -5);
    EXPECT_EQ(told_, "");
  }
  const std::vector<Json> part =
      stream(s01 + "/test_frame.%04d.exr", path("part/x.####.png"), {"--range=-10--5", "--cut-at", "-7"});
  EXPECT_EQ(frames_of(part), (Numbers{-10, -9, -8, -7, -6, -5}));
  EXPECT_EQ(part[3].at("cut"), true);
  EXPECT_EQ(part[5].at("output"), path("part/x.-005.png"));
  EXPECT_EQ(frames_of(stream(s01, path("two/%d.png"), {"--range", "-9--6x3"})), (Numbers{-9, -6}));
  EXPECT_EQ(names_in(path("two")), (std::vector<std::string>{"-6.png", "-9.png"}));
}

TEST_F(FieldSequence, FramesAround0PlayInTheirOrderByEveryInput) {
  const std::string s02 = data("S02_around0");
  for (const std::string& input : {s02, s02 + "/f.%04d.exr", s02 + "/f.####.exr"}) {
    const std::vector<Json> lines = stream(input, path("out"), {});
    EXPECT_EQ(frames_of(lines), (Numbers{-2, -1, 0, 1, 2})) << input;
    EXPECT_EQ(names_in(path("out")), (std::vector<std::string>{"f.-001.png", "f.-002.png", "f.0000.png",
                                                               "f.0001.png", "f.0002.png"}));
  }
  EXPECT_EQ(frames_of(stream(s02, path("every/%04d.png"), {"--range", "-2-2x2"})), (Numbers{-2, 0, 2}));
  EXPECT_EQ(names_in(path("every")), (std::vector<std::string>{"-002.png", "0000.png", "0002.png"}));
}

TEST_F(FieldFrames, AnExposureFileKeepsNegativeNumbers) {
  make_frames({-3, -2, -1, 0, 1});
  stream_in("whole/%04d.png", {"--dither", "--save-exposures", path("whole.json")});
  const Json saved = Json::parse(read_file(path("whole.json")));
  EXPECT_EQ(saved.at("zero"), -3);
  EXPECT_EQ(saved.at("frames").front().at("frame"), -3);
  EXPECT_EQ(saved.at("frames").front().at("media_time_ns"), 0);
  EXPECT_EQ(saved.at("state").at("frame"), 1);
  for (const char* range : {"-3--2", "-1-1"}) {
    stream_in("parts/%04d.png", {"--dither", "--range", range, "--exposures", path("whole.json")});
  }
  stream_in("runs/%04d.png", {"--dither", "--range", "-3--2", "--save-exposures", path("a.json")});
  EXPECT_EQ(Json::parse(read_file(path("a.json"))).at("state").at("frame"), -2);
  stream_in("runs/%04d.png",
            {"--dither", "--range", "-1-", "--state", path("a.json"), "--save-exposures", path("b.json")});
  EXPECT_EQ(Json::parse(read_file(path("b.json"))).at("state"), saved.at("state"));
  for (const int64_t number : {-3, -2, -1, 0, 1}) {
    EXPECT_TRUE(same("whole", "parts", number)) << number;
    EXPECT_TRUE(same("whole", "runs", number)) << number;
  }
  const Outcome early =
      candela({"stream", path("in"), path("no"), "--range", "-2-", "--state", path("a.json")});
  EXPECT_TRUE(says(
      early.err, "a.json ends after frame -2 and the first frame here is -2; begin later, with --range -1-"));
}

TEST_F(FieldFrames, NamesThatWouldLoseTheSignGetANote) {
  make_frames({-2, -1, 0});
  stream_in("out/shot-%04d.png", {});
  EXPECT_TRUE(says(told_, "shot--002.png: its minus will be read as a hyphen"));
  stream_in("out/shot.%04d.png", {});
  EXPECT_EQ(told_, "");
  stream_in("first/%d.png", {"--first", "-1"});
  EXPECT_EQ(names_in(path("first")), (std::vector<std::string>{"-1.png", "0.png", "1.png"}));
}

TEST_F(FieldFrames, HiddenFilesAreLeftOutAndOneNoteCountsThem) {
  make_frames({1, 2});
  write_file(path("in/._f.0001.exr"), "attributes of macOS");
  write_file(path("in/.f.0003.exr"), "an unfinished copy");
  EXPECT_EQ(frames_of(stream_in("out", {})), (Numbers{1, 2}));
  const std::string note = "left out: 2 hidden files (" + path("in/._f.0001.exr") + " ...)";
  EXPECT_TRUE(says(told_, note));
  const Outcome render = candela({"render", path("in"), path("stills/")});
  EXPECT_EQ(render.code, 0) << render.err;
  EXPECT_TRUE(says(render.err, note));
  EXPECT_EQ(names_in(path("stills")), (std::vector<std::string>{"f.0001.png", "f.0002.png"}));
  const Outcome meter = candela({"meter", path("in"), "--json", "-"});
  EXPECT_EQ(meter.code, 0) << meter.err;
  EXPECT_TRUE(says(meter.err, note));
}

// Frames -2 .. 9 without -1, 3, 4, 8 and 9. Files 1 and 5 are bad.
class Parts : public FieldFrames {
 protected:
  void SetUp() override {
    make_frames({-2, 0, 1, 2, 5, 6, 7});
    write_file(frame(1), "no image at all");
    write_file(frame(5), "no image at all");
    stream_in("whole/%04d.png", {"--range", "-2-9", "--missing", "hold", "--skip-bad", "--dither",
                                 "--save-exposures", path("whole.json")});
    ASSERT_EQ(names_in(path("whole")).size(), 12u);
  }
};

TEST_F(Parts, ABadFrameIsHeldAsAMissingOneIs) {
  for (const auto& [number, shown] :
       std::vector<std::pair<int, int>>{{-1, -2}, {1, 0}, {3, 2}, {4, 2}, {5, 2}, {9, 7}}) {
    EXPECT_TRUE(read_file(path(absl::StrFormat("whole/%04d.png", number))) ==
                read_file(path(absl::StrFormat("whole/%04d.png", shown))))
        << number;
  }
  const std::vector<Json> lines = stream_in("again", {"--range", "0-6", "--missing", "hold", "--skip-bad"});
  ASSERT_EQ(frames_of(lines), (Numbers{0, 1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(lines[5].at("held"), true);
  EXPECT_EQ(lines[5].at("input"), frame(2));
  EXPECT_TRUE(says(lines[5].at("error").get<std::string>(), "f.0005.exr"));
  EXPECT_EQ(lines[3].at("held"), true);
  EXPECT_FALSE(lines[3].contains("error"));
  EXPECT_EQ(lines[7].at("summary").at("held"), 4);
  EXPECT_EQ(lines[7].at("summary").at("skipped"), 2);
  EXPECT_EQ(lines[7].at("summary").at("written"), 3);
  EXPECT_TRUE(says(told_, "f.0005.exr"));
  EXPECT_TRUE(says(told_, "; the image before is repeated"));
}

TEST_F(Parts, EveryPartHasTheBitsOfTheWholeWhateverIsMissingAtItsEnds) {
  for (int first = -2; first <= 9; ++first) {
    for (const int frames : {1, 3}) {
      const int last = std::min(first + frames - 1, 9);
      std::filesystem::remove_all(path("part"));
      stream_in("part/%04d.png", {absl::StrFormat("--range=%d-%d", first, last), "--missing", "hold",
                                  "--skip-bad", "--dither", "--exposures", path("whole.json")});
      EXPECT_EQ(names_in(path("part")).size(), static_cast<size_t>(last - first + 1));
      for (int number = first; number <= last; ++number) {
        EXPECT_TRUE(same("whole", "part", number)) << number << " of " << first << " .. " << last;
      }
    }
  }
  stream_in("steps/%04d.png", {"--range=-1-9x2", "--missing", "hold", "--skip-bad", "--dither", "--exposures",
                               path("whole.json")});
  for (int number = -1; number <= 9; number += 2) EXPECT_TRUE(same("whole", "steps", number)) << number;
}

TEST_F(Parts, RunsThatContinueEachOtherHaveTheBitsOfTheWhole) {
  for (const Options& cuts : std::vector<Options>{{"--detect-cuts", "0.5"}, {"--cut-at", "-1,4"}}) {
    const Options options = with({"--missing", "hold", "--skip-bad", "--dither", "--encoding", "png"}, cuts);
    stream_in("one/%04d.png", with({"--range=-2-9"}, options));
    for (const int split : {-1, 1, 3, 4, 5, 7}) {
      stream_in(
          "runs/%04d.png",
          with({absl::StrFormat("--range=-2-%d", split - 1), "--save-exposures", path("a.json")}, options));
      stream_in("runs/%04d.png",
                with({absl::StrFormat("--range=%d-9", split), "--state", path("a.json")}, options));
      for (int number = -2; number <= 9; ++number) {
        EXPECT_TRUE(same("one", "runs", number)) << number << ", split at " << split << Json(cuts);
      }
    }
  }
}

TEST_F(Parts, AFrameThatTheServerRefusesIsHeldToo) {
  Image nan = *make_image(8, 8, ImageFormat::kRgba32f);
  const float value = std::nanf("");
  std::memcpy(nan.pixels.data(), &value, sizeof value);
  ASSERT_OK(write_image(frame(6), nan));
  const Options options{"--missing", "hold",       "--skip-bad", "--bad-values",
                        "reject",    "--exposure", "0",          "--dither"};
  stream_in("one/%04d.png", with({"--range=-2-9"}, options));
  EXPECT_TRUE(read_file(path("one/0006.png")) == read_file(path("one/0002.png")));
  for (const char* range : {"6-9", "5-6"}) {
    stream_in("part/%04d.png", with({"--range", range}, options));
    EXPECT_TRUE(same("one", "part", 6)) << range;
  }
  EXPECT_TRUE(same("one", "part", 7));
  EXPECT_TRUE(same("one", "part", 9));
}

TEST_F(Parts, WithoutAnImageBeforeAFrameHasNone) {
  write_file(frame(-2), "no image at all");
  write_file(frame(0), "no image at all");
  const std::vector<Json> lines =
      stream_in("out/%04d.png", {"--missing", "hold", "--skip-bad", "--range=-2-3"});
  ASSERT_EQ(frames_of(lines), (Numbers{-2, -1, 0, 1, 2, 3}));
  EXPECT_EQ(lines[1].at("error"), "frame -1 is missing, and no frame before it has an image");
  EXPECT_EQ(names_in(path("out")), (std::vector<std::string>{"0002.png", "0003.png"}));
  EXPECT_EQ(lines[6].at("summary").at("skipped"), 3);
  const Outcome strict = candela({"stream", path("in"), path("out"), "--missing", "hold", "--range", "3-4"});
  EXPECT_EQ(strict.code, 0) << strict.err;
  const Outcome bad = candela({"stream", path("in"), path("out"), "--missing", "hold", "--range=-1--1"});
  EXPECT_NE(bad.code, 0);
  EXPECT_TRUE(says(bad.err, "f.-002.exr"));
  const Outcome none = candela({"stream", path("in"), path("none/%04d.png"), "--missing", "hold", "--range",
                                "3-4", "--save-exposures", path("none.json")});
  EXPECT_TRUE(says(none.err, "there are no exposures to save"));
}

TEST_F(Parts, AnImageDoesNotReplaceAFileThatMayBeRepeated) {
  const std::string before = read_file(frame(2));
  const Outcome outcome =
      candela({"stream", path("in"), path("in/f.%04d.exr"), "--range", "6-7", "--first", "2"});
  EXPECT_EQ(outcome.code, 2) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "f.0002.exr is one of the inputs"));
  EXPECT_TRUE(read_file(frame(2)) == before);
}

TEST_F(FieldFrames, ABackwardRangeIsRefusedInOneSentence) {
  make_frames({1, 2});
  const Outcome outcome = candela({"stream", path("in"), path("out"), "--range", "2-1"});
  EXPECT_EQ(outcome.code, 2);
  EXPECT_EQ(
      outcome.err,
      "candela: error: --range is \"2-1\", which runs backwards; frames are rendered in the order of their "
      "numbers, so give 1-2\n");
}

// Writes an image of 4 x 4 whose framesPerSecond is `attribute` under this name; null for none.
void write_exr_of_rate(const std::string& path, const std::string& name, const Imf::Attribute* attribute) {
  Imf::Header header(4, 4);
  if (attribute != nullptr) header.insert(name, *attribute);
  Imf::FrameBuffer frame;
  std::vector<float> pixels(16, 0.18f);
  for (const char* channel : {"R", "G", "B"}) {
    header.channels().insert(channel, Imf::Channel(Imf::FLOAT));
    frame.insert(channel, Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(pixels.data()), 4, 16));
  }
  Imf::OutputFile file(path.c_str(), header);
  file.setFrameBuffer(frame);
  file.writePixels(4);
}

TEST_F(FieldFrames, ARateIsReadInAnyCaseAndType) {
  struct Case {
    std::string name;
    std::shared_ptr<Imf::Attribute> attribute;
    std::string rate;  // "" if the file says none
  };
  const auto text = [](const char* words) { return std::make_shared<Imf::StringAttribute>(words); };
  for (const Case& c : std::vector<Case>{
           {"framesPerSecond", std::make_shared<Imf::RationalAttribute>(Imf::Rational(25, 1)), "25"},
           {"FramesPerSecond", std::make_shared<Imf::RationalAttribute>(Imf::Rational(30000, 1001)),
            "30000/1001"},
           {"framespersecond", std::make_shared<Imf::FloatAttribute>(25.0f), "25"},
           {"FramesPerSecond", std::make_shared<Imf::FloatAttribute>(23.976f), "24000/1001"},
           {"FRAMESPERSECOND", std::make_shared<Imf::FloatAttribute>(12.5f), "12.5"},
           {"framesPerSecond", std::make_shared<Imf::DoubleAttribute>(59.94), "60000/1001"},
           {"FramesPerSecond", std::make_shared<Imf::IntAttribute>(48), "48"},
           {"framesPerSecond", text("23.98"), "24000/1001"},
           {"framesPerSecond", std::make_shared<Imf::FloatAttribute>(119.88f), "120000/1001"},
           {"FramesPerSecond", text("25"), "25"},
           {"FramesPerSecond", text("24000/1001"), "24000/1001"},
           {"framesPerSecond", text(" 29.97 "), "30000/1001"},
           {"FramesPerSecond", std::make_shared<Imf::V2iAttribute>(Imath::V2i(24000, 1001)), "24000/1001"},
           {"FramesPerSecond", std::make_shared<Imf::V2fAttribute>(Imath::V2f(50, 2)), "25"},
           {"framesPerSecond", text("fast"), ""},
           {"framesPerSecond", text("24/0"), ""},
           {"framesPerSecond", text("1/2/3"), ""},
           {"framesPerSecond", text("nan"), ""},
           {"framesPerSecond", std::make_shared<Imf::IntAttribute>(-24), ""},
           {"FramesPerSecond", std::make_shared<Imf::FloatAttribute>(INFINITY), ""},
           {"framesPerSecond", std::make_shared<Imf::RationalAttribute>(Imf::Rational(0, 0)), ""},
           {"frameRate", std::make_shared<Imf::FloatAttribute>(25.0f), ""}}) {
    std::filesystem::create_directories(path("in"));
    write_exr_of_rate(path("in/1.exr"), c.name, c.attribute.get());
    write_exr_of_rate(path("in/2.exr"), c.name, c.attribute.get());
    const std::string words = c.name + " " + c.attribute->typeName() + " " + c.rate;
    const Json summary = stream_in("out", {}).back().at("summary");
    EXPECT_EQ(summary.at("fps"), c.rate.empty() ? "24" : c.rate) << words;
    EXPECT_EQ(summary.at("fps_from"), c.rate.empty() ? "default" : "file") << words;
  }
}

TEST_F(FieldFrames, APartHasTheRateOfTheWhole) {
  std::filesystem::create_directories(path("in"));
  const Imf::IntAttribute film(24), video(25);
  for (const auto& [name, rate] : std::vector<std::pair<const char*, const Imf::Attribute*>>{
           {"1", nullptr}, {"2", &video}, {"3", &video}}) {
    write_exr_of_rate(path("in/") + name + ".exr", "FramesPerSecond", rate);
  }
  const auto rate = [this](const Options& options) {
    return stream_in("out/%d.exr", options).back().at("summary").at("fps_from");
  };
  EXPECT_EQ(rate({"--exposure", "0"}), "default");
  const std::string whole = read_file(path("out/3.exr"));
  EXPECT_EQ(rate({"--range", "3", "--exposure", "0"}), "default") << "the sequence's first file says none";
  EXPECT_TRUE(read_file(path("out/3.exr")) == whole);
  std::filesystem::remove(path("in/1.exr"));
  EXPECT_EQ(rate({"--range", "3", "--exposure", "0"}), "file");
  write_exr_of_rate(path("in/2.exr"), "framesPerSecond", &film);
  EXPECT_EQ(stream_in("out", {"--range", "3"}).back().at("summary").at("fps"), "24");
}

}  // namespace
}  // namespace candela
