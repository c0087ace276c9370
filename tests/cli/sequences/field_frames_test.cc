// Sequences as people have them: numbers below 0, files of other systems in the folder, parts whose ends are
// missing, frame rates as other programs write them. Field tests use the shared test data.
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

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <memory>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/sequences/stream_fixture.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Json = nlohmann::json;
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
