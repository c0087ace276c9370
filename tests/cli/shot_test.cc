// Shots: `candela meter` on sequences, exposure files, and runs in parts that give the images of one run.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <thread>

#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/image/image.h"
#include "server/render/color/portable_math.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Json = nlohmann::json;
using Options = std::vector<std::string>;

constexpr int kFirst = 100, kFrames = 24;
const Options kLooksAhead{"--lookahead", "4", "--detect-cuts", "0.5", "--cut-at", "119"};

class Shot : public ::testing::Test {
 protected:
  // Three scenes in light that varies, as shot.0100.exr .. shot.0123.exr in the folder "in".
  void SetUp() override {
    std::filesystem::create_directory(in());
    for (int i = 0; i < kFrames; ++i) {
      Image image = *make_image(192, 128, ImageFormat::kRgba32f);
      const float light = std::exp2(3 * std::sin(0.7f * static_cast<float>(i)));
      for (size_t at = 0; at < size_t{192} * 128; ++at) {
        const size_t x = at % 192, y = at / 192;
        const bool lit = i < 7 ? x < 64 : i < 15 ? y < 64 : x >= 128;
        const float grey = light * (lit ? 1.0f : 0.03f) * (1 + static_cast<float>((x + y) % 7));
        const float pixel[] = {grey, grey, grey / 2, 1};
        std::memcpy(image.pixels.data() + at * sizeof pixel, pixel, sizeof pixel);
      }
      ASSERT_OK(write_image(frame(kFirst + i), image));
    }
  }

  // Runs the command and returns its standard output.
  static std::string run(const Options& arguments, const Options& more = {}) {
    const Outcome outcome = candela(with(arguments, more));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return outcome.out;
  }
  void stream(const std::string& out, const Options& options, const std::string& input = "in") const {
    run({"stream", path(input), path(out) + "/%04d.png", "-q", "--dither"}, options);
  }
  Json saved(const std::string& name) const { return Json::parse(read_file(path(name))); }

  void expect_same_images(const std::string& whole, const std::string& parts, int first = kFirst) const {
    for (int i = first; i < kFirst + kFrames; ++i) {
      const std::string name = absl::StrFormat("/%04d.png", i);
      const std::string expected = read_file(path(whole) + name);
      ASSERT_FALSE(expected.empty());
      EXPECT_TRUE(read_file(path(parts) + name) == expected) << name;
    }
  }

  // Fails with these words in one line.
  static void expect_refused(const Options& arguments, int code, const std::string& words) {
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, code) << words << ": " << outcome.err;
    EXPECT_TRUE(says(outcome.err, words));
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }

  std::string in() const { return path("in"); }
  std::string frame(int number) const { return in() + absl::StrFormat("/shot.%04d.exr", number); }
  std::string path(const std::string& name) const { return folder_.path(name); }

  const TemporaryFolder folder_;
};

TEST_F(Shot, PartsThatRunAtOnceGiveTheImagesOfOneRun) {
  stream("whole", kLooksAhead);
  Options meter{"meter", in(), "-q", "--save-exposures", path("shot.json")};
  run(meter, kLooksAhead);
  // The last machine has only its own files.
  std::filesystem::create_directory(path("some"));
  for (int i = 116; i < kFirst + kFrames; ++i) {
    std::filesystem::copy(frame(i), path("some") + absl::StrFormat("/shot.%04d.exr", i));
  }
  // The cuts are those of the whole shot.
  const Options given{"--exposures", path("shot.json"), "--cut-at", "107,119"};
  const auto part = [&](const std::string& range, const std::string& input) {
    Options options = given;
    options.insert(options.end(), {"--range", range});
    stream("parts", options, input);
  };
  std::thread first([&] { part("100-108", "in"); }), second([&] { part("109-115", "in"); });
  part("116-123", "some");
  first.join();
  second.join();
  expect_same_images("whole", "parts");
  const Json file = saved("shot.json");
  EXPECT_EQ(file.at("frames").at(7).at("cut"), true) << "the first detected cut belongs to the test";
  EXPECT_EQ(file.at("frames").at(19).at("cut"), true) << "and so does the one that was marked";
  EXPECT_EQ(file.at("zero"), kFirst);
}

TEST_F(Shot, AStateContinuesARunInAnother) {
  for (const char* adaptation : {"log", "linear"}) {
    const Options options{"--adaptation", adaptation, "--detect-cuts", "0.5", "--fps", "24000/1001"};
    const auto with = [&](const Options& more) {
      Options all = options;
      all.insert(all.end(), more.begin(), more.end());
      return all;
    };
    stream("whole", with({"--save-exposures", path("whole.json")}));
    // The cut at frame 107 is detected by the picture in the state.
    stream("parts", with({"--range", "100-106", "--save-exposures", path("a.json")}));
    const Options rest{"--adaptation", adaptation, "--detect-cuts", "0.5"};
    Options second = rest, metered{"meter", in(), "-q"};
    second.insert(second.end(),
                  {"--range", "107-", "--state", path("a.json"), "--save-exposures", path("b.json")});
    stream("parts", second);
    expect_same_images("whole", "parts");
    metered.insert(metered.end(), rest.begin(), rest.end());
    run(metered, {"--range", "107-", "--state", path("a.json"), "--save-exposures", path("c.json")});
    EXPECT_EQ(read_file(path("b.json")), read_file(path("c.json"))) << "meter continues like stream";
    const Json whole = saved("whole.json"), last = saved("b.json");
    Json frames = saved("a.json").at("frames");
    for (const Json& one : last.at("frames")) frames.push_back(one);
    EXPECT_EQ(frames, whole.at("frames"));
    EXPECT_EQ(last.at("state"), whole.at("state"));
    EXPECT_EQ(last.at("frame_rate"), "24000/1001");
  }
}

TEST_F(Shot, MeterAndStreamSaveTheSameExposures) {
  for (const Options& options :
       std::vector<Options>{{},
                            kLooksAhead,
                            {"--percentiles", "20,80", "--weights", "center"},
                            {"--speed-up", "9", "--key", "0.3", "--range", "105-112x2"},
                            {"--tier", "reference", "--range", "100-101"},
                            {"--exposure", "-2.5", "--range", "100-102"}}) {
    Options saving = options;
    saving.insert(saving.end(), {"--save-exposures", path("streamed.json")});
    stream("out", saving);
    saving.back() = path("metered.json");
    run({"meter", in(), "-q"}, saving);
    EXPECT_EQ(read_file(path("metered.json")), read_file(path("streamed.json")));
    EXPECT_GE(saved("metered.json").at("frames").size(), 2u);
  }
}

TEST_F(Shot, TheLockedExposureIsTheTargetOfTheMeanAndEveryFrameTakesIt) {
  const Options keyed{"--key", "0.25", "--compensation", "0.5"};
  run({"meter", in(), "-q", "--save-exposures", path("shot.json")}, keyed);
  const Json file = saved("shot.json");
  double sum = 0;
  for (const Json& one : file.at("frames")) sum += one.at("mean_log2_luminance").get<double>();
  const double locked = file.at("locked");
  EXPECT_EQ(locked, 0.25 * portable_exp2(0.5 - sum / kFrames));
  const Options given{"--locked-exposure", path("shot.json")};
  stream("out", given);
  const std::string lines =
      run({"stream", in(), path("out"), "-q", "--json", "-", "--lookahead", "2"}, given);
  int frames = 0;
  for (const absl::string_view line : absl::StrSplit(lines, '\n', absl::SkipEmpty())) {
    const Json json = Json::parse(line);
    if (!json.contains("frame")) continue;
    EXPECT_EQ(json.at("exposure"), locked) << json;
    ++frames;
  }
  EXPECT_EQ(frames, kFrames);
  const Json rendered = candela_json({"render", frame(104), path("one.png"), given[0], given[1]});
  EXPECT_EQ(rendered.at("exposure"), locked);
  EXPECT_TRUE(read_file(path("one.png")) == read_file(path("out/shot.0104.png")));
  run({"meter", in(), "-q", "--save-exposures", path("low.json"), "--max-exposure", "0.1"});
  EXPECT_EQ(saved("low.json").at("locked"), 0.1) << "the limits hold for it, too";
}

// The C library of Debian 12 rounds this power the other way.
TEST_F(Shot, TheLockedExposureOfAFixedOneIsThatOfItsFramesToTheLastBit) {
  run({"meter", in(), "-q", "--save-exposures", path("fixed.json"), "--exposure", "-7.9732"});
  const Json file = saved("fixed.json");
  EXPECT_EQ(file.at("locked"), portable_exp2(-7.9732));
  for (const Json& one : file.at("frames")) EXPECT_EQ(one.at("exposure"), file.at("locked")) << one;
}

TEST_F(Shot, MeterSaysWhatAShotNeeds) {
  const std::string text = run({"meter", in(), "--lookahead", "2", "--save-exposures", path("shot.json")});
  for (const char* word : {"24 frames metered", "exposure", "EV", "locked", "shot.json"}) {
    EXPECT_TRUE(says(text, word));
  }
  const std::string lines =
      run({"meter", in() + "/shot.####.exr", "--json", "-", "--exposure-plot", path("plot.svg")});
  const std::vector<std::string> each = absl::StrSplit(lines, '\n', absl::SkipEmpty());
  ASSERT_EQ(each.size(), kFrames + 1u);
  const Json first = Json::parse(each[0]), summary = Json::parse(each.back()).at("summary");
  EXPECT_EQ(first.at("frame"), kFirst);
  EXPECT_FALSE(first.contains("output"));
  EXPECT_EQ(first.at("exposure"), first.at("target"));
  EXPECT_EQ(summary.at("frames"), kFrames);
  EXPECT_EQ(summary.at("locked_exposure"), saved("shot.json").at("locked"));
  EXPECT_TRUE(says(read_file(path("plot.svg")), "<svg"));
  const std::string given =
      run({"stream", in(), path("out"), "--range", "100", "--exposures", path("shot.json")});
  EXPECT_TRUE(says(given, "24 fps, from the exposure file"));
}

TEST_F(Shot, FilesThatDoNotFitAreRefusedBeforeTheWork) {
  run({"meter", in(), "-q", "--range", "103-110", "--save-exposures", path("good.json")});
  const std::string good = read_file(path("good.json"));
  const Options stream{"stream", in(), path("out")};
  const auto refused = [&](const Options& options, int code, const std::string& words) {
    Options all = stream;
    all.insert(all.end(), options.begin(), options.end());
    expect_refused(all, code, words);
    EXPECT_FALSE(std::filesystem::exists(path("out"))) << words;
  };
  refused({"--exposures", path("good.json")}, 3, "no exposure for frame 100; it has frames from 103 to 110");
  refused({"--exposures", path("good.json"), "--range", "110-111"}, 3, "no exposure for frame 111");
  refused({"--state", path("good.json"), "--range", "110-"}, 3, "begin later, with --range 111-");
  refused({"--state", path("good.json"), "--range", "111-", "--fps", "25"}, 2, "--fps is 25");
  refused({"--exposures", path("none.json")}, 3, "none.json: cannot read this exposure file: No such file");
  refused({"--save-exposures", path("good.json/file.json")}, 5, "good.json");
  const auto damaged = [&](const std::string& from, const std::string& to, const std::string& words) {
    const std::string text = absl::StrReplaceAll(good, {{from, to}});
    ASSERT_NE(text, good) << from;
    write_file(path("bad.json"), text);
    refused({"--exposures", path("bad.json"), "--range", "103-110"}, 3, "bad.json: " + words);
  };
  damaged("\"version\": 1", "\"version\": 2",
          "the exposure file has version 2 and this candela reads version 1");
  damaged("candela-exposures", "other", "this is not an exposure file");
  damaged("\"frame\":104,", "\"frame\":110,", "frames[2].frame is not above the one before");
  damaged("\"locked\": ", "\"locked\": -", "locked is not a number between");
  damaged("\"frame\":104,", "", "frames[1].frame is not a frame's number");
  damaged("\"picture\":[]", "\"picture\":[1,2]", "state.picture is not an array of 64 cells");
  damaged("\"cut_pending\":false", "\"cut_pending\":0", "state.cut_pending is not true or false");
  damaged("\"frame_rate\": \"24\"", "\"frame_rate\": 24", "frame_rate is not a frame rate");
  damaged("\"zero\": 100", "\"zero\": 104", "zero is not a number up to that of the first frame");
  write_file(path("bad.json"), good.substr(0, good.size() / 2));
  refused({"--locked-exposure", path("bad.json")}, 3, "this is not an exposure file, or it is damaged");
}

TEST_F(Shot, OptionsThatContradictEachOtherAreRefused) {
  const Options file{path("any.json")};
  const Options stream{"stream", in(), path("out")};
  const auto refused = [&](const Options& options, const std::string& words) {
    Options all = stream;
    all.insert(all.end(), options.begin(), options.end());
    expect_refused(all, 2, words);
  };
  refused({"--exposures", "a", "--locked-exposure", "b"}, "--exposures and --locked-exposure both decide");
  refused({"--exposures", "a", "--state", "b"}, "--exposures and --state both decide");
  refused({"--locked-exposure", "a", "--exposure", "2"}, "--locked-exposure and --exposure both decide");
  refused({"--state", ""}, "--state is empty");
  const Options render{"render", frame(100), path("one.png"), "--locked-exposure", "a"};
  for (const Options& other : {Options{"--exposure", "1"}, Options{"--previous-exposure", "1"}}) {
    Options all = render;
    all.insert(all.end(), other.begin(), other.end());
    expect_refused(all, 2, "both decide the exposure");
  }
}

TEST_F(Shot, BadFramesAreLeftOut) {
  write_file(frame(105), "no image at all");
  expect_refused({"meter", in(), "-q"}, 3, "shot.0105.exr");
  run({"meter", in(), "-q", "--skip-bad", "--cut-at", "105", "--save-exposures", path("shot.json")});
  const Json frames = saved("shot.json").at("frames");
  ASSERT_EQ(frames.size(), kFrames - 1u);
  EXPECT_EQ(frames.at(5).at("frame"), 106);
  EXPECT_EQ(frames.at(5).at("cut"), true) << "the next frame begins the scene";
  run({"meter", in(), "-q", "--skip-bad", "--cut-at", "105", "--range", "100-105", "--save-exposures",
       path("first.json")});
  EXPECT_EQ(saved("first.json").at("state").at("cut_pending"), true);
  run({"meter", in(), "-q", "--range", "106-", "--state", path("first.json"), "--save-exposures",
       path("second.json")});
  EXPECT_EQ(saved("second.json").at("frames").front(), frames.at(5));
  const Outcome skipped =
      candela({"stream", in(), path("out"), "--skip-bad", "--exposures", path("shot.json")});
  EXPECT_EQ(skipped.code, 0) << skipped.err;
  EXPECT_TRUE(says(skipped.out, "23 of 24 frames"));
}

}  // namespace
}  // namespace candela
