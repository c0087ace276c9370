// `candela stream` and `candela bench`, and the sequence that `candela sample` makes.
#include <gtest/gtest.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <optional>
#include <set>
#include <thread>
#include <tuple>

#include "absl/strings/str_format.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/cli/stream_fixture.h"
#include "tests/support/daemon.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

using Json = nlohmann::json;
using Stream = StreamFixture;

TEST_F(Stream, ASequenceStepsInTheMiddleAndExposureFollowsAsDesigned) {
  make_frames(8);
  const std::vector<Json> lines = stream({"--fps", "10"});
  ASSERT_EQ(lines.size(), 9u);
  for (size_t i = 0; i < 8; ++i) {
    const Json& frame = lines[i];
    EXPECT_EQ(frame.at("frame"), i);
    EXPECT_EQ(frame.at("media_time_ns"), i * 100'000'000);
    EXPECT_EQ(png_facts(frame.at("output")).width, 64u) << frame;
    EXPECT_EQ(frame.at("output"), absl::StrFormat("%s/%04d.png", folder_.path("out"), i));
    const double exposure = frame.at("exposure"), target = frame.at("target");
    if (i == 0) {
      EXPECT_DOUBLE_EQ(exposure, target);
      continue;
    }
    // The recursion of docs/pipeline.md, section 3.
    const double before = lines[i - 1].at("exposure");
    EXPECT_EQ(frame.at("exposure_before"), before);
    const double alpha = 1 - std::exp(-0.1 * (target > before ? 3 : 1));
    EXPECT_NEAR(std::log2(exposure), std::log2(before) + (std::log2(target) - std::log2(before)) * alpha,
                1e-9);
  }
  const double step =
      lines[4].at("mean_log2_luminance").get<double>() - lines[3].at("mean_log2_luminance").get<double>();
  EXPECT_NEAR(step, 12, 1.5);
  const Json& summary = lines[8].at("summary");
  EXPECT_EQ(summary.at("written"), 8);
  EXPECT_EQ(summary.at("resumes"), 0);
}

TEST_F(Stream, EachFrameIsWhatRenderMakesOfItFromTheExposureBefore) {
  make_frames(4);
  const std::vector<std::string> look{"--curve", "reinhard", "--bloom-intensity", "0.2", "--key", "0.3"};
  std::vector<std::string> options = look;
  options.insert(options.end(), {"--fps", "8"});
  const std::vector<Json> lines = stream(options);
  ASSERT_EQ(lines.size(), 5u);
  for (size_t i = 1; i < 4; ++i) {
    const Outcome outcome = candela(
        with({"render", lines[i].at("input"), folder_.path("one.png"), "-q", "--previous-exposure",
              absl::StrFormat("%.17g", lines[i - 1].at("exposure").get<double>()), "--elapsed", "0.125"},
             look));
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_TRUE(read_file(folder_.path("one.png")) == image(absl::StrFormat("%04d.png", i))) << i;
  }
}

TEST_F(Stream, ADaemonGivesTheBytesThatTheServerInsideGives) {
  make_frames(5);
  const ListeningDaemon daemon;
  for (const std::vector<std::string>& options : std::vector<std::vector<std::string>>{
           {}, {"--lookahead", "2"}, {"--detect-cuts"}, {"--detect-cuts", "0.5"}}) {
    stream(options, "here");
    std::vector<std::string> there = options;
    there.insert(there.end(), {"--server", "127.0.0.1:1," + daemon.address()});
    stream(there, "there");
    for (int i = 0; i < 5; ++i) {
      const std::string name = absl::StrFormat("%04d.png", i);
      EXPECT_TRUE(image(name, "here") == image(name, "there")) << name;
      EXPECT_EQ(png_facts(folder_.path("here/" + name)).width, 64u);
    }
  }
}

TEST_F(Stream, DetectedCutsAreSaidAndTaken) {
  make_frames(3, "512x384");
  Image corner = *make_image(512, 512, ImageFormat::kRgba32f);
  for (size_t i = 0; i < corner.pixels.size(); i += sizeof(float)) {
    const size_t x = i / 16 % 512, y = i / 16 / 512;
    const float light = x < 256 && y < 256 ? 20.0f : 0.02f;
    std::memcpy(corner.pixels.data() + i, &light, sizeof light);
  }
  for (const char* name : {"/0003.exr", "/0004.exr"}) ASSERT_OK(write_image(in() + name, corner));
  const std::vector<Json> undetected = stream({}), lines = stream({"--detect-cuts"});
  ASSERT_EQ(lines.size(), 6u);
  for (size_t i = 1; i < 5; ++i) {
    EXPECT_EQ(lines[i].at("cut"), i == 3) << lines[i];
    EXPECT_EQ(undetected[i].at("cut"), false);
  }
  EXPECT_EQ(lines[3].at("exposure"), lines[3].at("target"));
  EXPECT_NE(undetected[3].at("exposure"), undetected[3].at("target"));
}

TEST_F(Stream, TheServerCanMakeTheFiles) {
  make_frames(3);
  stream({"--encoding", "png"}, "png");
  EXPECT_EQ(png_facts(folder_.path("png/0001.png")).width, 64u);
  stream({"--encoding", "jpeg"}, "jpeg");
  EXPECT_EQ(image("0001.jpg", "jpeg").substr(0, 2), "\xff\xd8");
}

TEST_F(Stream, InputsAreInNaturalOrderAndOutputsAreNumbered) {
  std::filesystem::create_directory(in());
  for (const char* name : {"f1.exr", "f2.exr", "f10.exr"}) write_small_exr(folder_.path("in/") + name);
  write_file(folder_.path("in/readme.txt"), "no image");
  for (const std::string& input : {in(), in() + "/f*.exr", in() + "/f%d.exr", in() + "/*.exr"}) {
    const Outcome outcome = candela({"stream", input, folder_.path("out/a%03d.jpg"), "-q", "--json", "-",
                                     "--first", "7", "--missing", "skip", "--quality", "80"});
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const std::vector<Json> lines = lines_of(outcome.out);
    ASSERT_EQ(lines.size(), 4u) << input;
    EXPECT_EQ(lines[1].at("input"), in() + "/f2.exr");
    EXPECT_EQ(lines[2].at("input"), in() + "/f10.exr");
    EXPECT_EQ(lines[2].at("output"), folder_.path("out/a009.jpg"));
    EXPECT_EQ(image("a009.jpg").substr(0, 2), "\xff\xd8");
  }
}

TEST_F(Stream, FramesOfManySizesAndColoursAreOneSession) {
  std::filesystem::create_directory(in());
  write_small_exr(in() + "/1.exr");
  for (const auto& [name, size] :
       {std::pair("/2.exr", "80x60"), std::pair("/3.exr", "33x90"), std::pair("/4.exr", "1x1")}) {
    ASSERT_EQ(candela({"sample", in() + name, "--size", size, "-q"}).code, 0);
  }
  Image wide = *make_image(20, 10, ImageFormat::kRgba16f);
  wide.chromaticities = {0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f, 0.3127f, 0.3290f};
  ASSERT_OK(write_image(in() + "/5.exr", wide));
  const std::vector<Json> lines = stream({"--exposure", "0"});
  ASSERT_EQ(lines.size(), 6u);
  EXPECT_EQ(lines[2].at("width"), 33);
  for (int i = 1; i <= 5; ++i) {
    const std::string input = lines[static_cast<size_t>(i - 1)].at("input");
    ASSERT_EQ(candela({"render", input, folder_.path("one.png"), "-q", "--exposure", "0"}).code, 0);
    EXPECT_TRUE(read_file(folder_.path("one.png")) == image(absl::StrFormat("%d.png", i))) << input;
  }
}

TEST_F(Stream, ABadFrameStopsItByNameOrIsSkippedAndCounted) {
  make_frames(5);
  write_file(in() + "/0002.exr", "no image at all");
  const Outcome stopped = candela({"stream", in(), folder_.path("out")});
  EXPECT_EQ(stopped.code, 3);
  EXPECT_EQ(stopped.err.find("candela: error: " + in() + "/0002.exr: "), 0u) << stopped.err;
  EXPECT_EQ(png_facts(folder_.path("out/0001.png")).width, 64u) << "what was there before is written";

  const Outcome skipped =
      candela({"stream", in(), folder_.path("out"), "--skip-bad", "--json", folder_.path("json")});
  ASSERT_EQ(skipped.code, 0) << skipped.err;
  EXPECT_TRUE(says(skipped.err, "0002.exr"));
  EXPECT_TRUE(says(skipped.out, "4 of 5 frames"));
  const std::vector<Json> lines = lines_of(read_file(folder_.path("json")));
  ASSERT_EQ(lines.size(), 6u);
  EXPECT_TRUE(lines[2].contains("error"));
  EXPECT_EQ(lines[3].at("media_time_ns"), 125'000'000) << "a skipped frame keeps its time";
  EXPECT_EQ(lines[5].at("summary").at("skipped"), 1);
}

TEST_F(Stream, AFrameThatTheServerRefusesIsNamed) {
  std::filesystem::create_directory(in());
  write_small_exr(in() + "/1.exr");
  Image bad = *make_image(8, 8, ImageFormat::kRgba16f);
  bad.pixels.data()[1] = std::byte{0x7e};  // a NaN
  ASSERT_OK(write_image(in() + "/2.exr", bad));
  write_small_exr(in() + "/3.exr");
  const Outcome stopped = candela({"stream", in(), folder_.path("out"), "--bad-values", "reject", "-q"});
  EXPECT_EQ(stopped.code, 3);
  EXPECT_EQ(stopped.err.find("candela: error: " + in() + "/2.exr: "), 0u) << stopped.err;
  const Outcome skipped =
      candela({"stream", in(), folder_.path("out"), "--bad-values", "reject", "--skip-bad", "--json", "-"});
  ASSERT_EQ(skipped.code, 0) << skipped.err;
  EXPECT_EQ(lines_of(skipped.out).back().at("summary").at("skipped"), 1);
}

// The second and the third frame have values that are no light.
TEST_F(Stream, ValuesThatAreNoNumbersAreCountedAndSaidOnce) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  std::filesystem::create_directory(in());
  for (const auto& [name, red, green] : {std::tuple("/1.pfm", 1.0f, 1.0f), std::tuple("/2.pfm", kNan, kInf),
                                         std::tuple("/3.pfm", kNan, -1.0f)}) {
    std::string pfm = "PF\n2 1\n-1.0\n";
    for (const float value : {red, green, 1.0f, 1.0f, 1.0f, 1.0f}) {
      pfm.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
    write_file(in() + name, pfm);
  }
  for (const std::vector<std::string>& command :
       std::vector<std::vector<std::string>>{{"stream", in(), folder_.path("out")}, {"meter", in()}}) {
    std::vector<std::string> arguments = command;
    arguments.insert(arguments.end(), {"--json", "-"});
    const Outcome outcome = candela(arguments);
    ASSERT_EQ(outcome.code, 0) << outcome.err;
    const std::vector<Json> lines = lines_of(outcome.out);
    ASSERT_EQ(lines.size(), 4u);
    EXPECT_EQ(lines[0].at("bad_values"), Json({{"nan", 0}, {"inf", 0}, {"negative", 0}}));
    EXPECT_EQ(lines[1].at("bad_values"), Json({{"nan", 1}, {"inf", 1}, {"negative", 0}}));
    EXPECT_EQ(lines[2].at("bad_values"), Json({{"nan", 1}, {"inf", 0}, {"negative", 1}}));
    const std::string note = "note: " + in() + "/2.pfm: 1 NaN and 1 infinite components were taken as 0";
    EXPECT_TRUE(says(outcome.err, note));
    EXPECT_EQ(outcome.err.find("were taken as"), outcome.err.rfind("were taken as")) << outcome.err;
  }
}

TEST_F(Stream, TheExposurePlotIsDrawn) {
  make_frames(6);
  stream({"--exposure-plot", folder_.path("plot.svg"), "--lookahead", "2"});
  const std::string svg = read_file(folder_.path("plot.svg"));
  for (const char* word : {"<?xml", "<svg", "xmlns", "exposure", "target", "luminance"}) {
    EXPECT_TRUE(says(svg, word));
  }
}

TEST_F(Stream, TheExposurePlotOfOneLateFrameShowsIt) {
  make_frames(6);
  stream({"--exposure-plot", folder_.path("plot.svg"), "--range", "5", "--fps", "0.001"});
  EXPECT_TRUE(says(read_file(folder_.path("plot.svg")), ">5000<")) << "no tic at 5000 s";
}

// Streams on two daemons, of which the first is killed on the way. Both need the same keys, so that the
// second accepts the first one's tokens.
class KilledServer : public Stream {
 protected:
  void start(const std::vector<std::string>& first, const std::vector<std::string>& second) {
    make_frames(40, "320x200");
    write_file(folder_.path("keys"), "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n");
    std::filesystem::permissions(folder_.path("keys"), std::filesystem::perms::owner_read);
    const auto with_keys = [this](std::vector<std::string> arguments) {
      arguments.insert(arguments.end(), {"--resume-keys", folder_.path("keys")});
      return arguments;
    };
    first_.emplace(with_keys(first));
    second_.emplace(with_keys(second));
  }
  Outcome stream_on_both() {
    std::thread killer([&] {
      const std::string some = folder_.path("out/0006.png");
      for (int i = 0; i < 2000 && !std::filesystem::exists(some); ++i) {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      }
      first_->stop(SIGKILL);
    });
    Outcome outcome = candela({"stream", in(), folder_.path("out"), "--json", folder_.path("json"),
                               "--server", first_->address() + "," + second_->address()});
    killer.join();
    return outcome;
  }

  std::optional<ListeningDaemon> first_, second_;
};

TEST_F(KilledServer, TheSessionGoesOnOnAnotherOne) {
  start({}, {});
  ASSERT_NE(first_->address(), "");
  ASSERT_NE(second_->address(), "");
  stream({}, "whole");
  const Outcome outcome = stream_on_both();
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "resumed on " + second_->address()));
  EXPECT_FALSE(says(outcome.err, "bits"));
  const Json summary = lines_of(read_file(folder_.path("json"))).back().at("summary");
  EXPECT_EQ(summary.at("resumes"), 1) << summary;
  EXPECT_EQ(summary.at("server"), second_->address());
  for (int i = 0; i < 40; ++i) {
    const std::string name = absl::StrFormat("%04d.png", i);
    EXPECT_TRUE(image(name) == image(name, "whole")) << name;
  }
}

TEST_F(KilledServer, AnotherOneWithOtherBitsIsNamed) {
  start({"--executor", "device"}, {"--executor", "host"});
  ASSERT_NE(first_->address(), "");
  if (second_->address().empty()) GTEST_SKIP() << "this processor cannot make the passes";
  std::set<std::string> told;
  for (const std::string& address : {first_->address(), second_->address()}) {
    const std::string json = candela({"info", "--server", address, "--json", "-"}).out;
    const std::string bits = Json::parse(json).at("device").at("bits");
    EXPECT_EQ(bits.size(), 16u);
    EXPECT_TRUE(says(candela({"info", "--server", address}).out, "bits       " + bits));
    told.insert(bits);
  }
  EXPECT_EQ(told.size(), 2u);
  const Outcome outcome = stream_on_both();
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "servers do not render the same bits"));
}

TEST_F(Stream, WrongUseIsSaidInOneLine) {
  make_frames(2);
  struct Case {
    std::vector<std::string> arguments;
    std::string words;
    int code = 2;
  };
  const std::string out = folder_.path("out");
  for (const Case& c :
       std::vector<Case>{{{in()}, "out/%04d.png"},
                         {{in(), out + "/one.png"}, "is a single file"},
                         {{in(), out + "/%04d-%d.png"}, "a pattern has one number"},
                         {{in(), out + "/%x.png"}, "a pattern has one number"},
                         {{in(), out + "/%d.gif"}, "use .png"},
                         {{in(), out, "--bits", "16", "--quality", "3"}, "--quality is for .jpg"},
                         {{in(), out + "/%d.jpg", "--encoding", "png"}, "--encoding makes PNG files"},
                         {{in(), out, "--fps", "0"}, "--fps is 0"},
                         {{in(), out, "--fps", "24/0"}, "--fps is 24/0"},
                         {{in(), out, "--range", "5-1"}, "--range is \"5-1\""},
                         {{in(), out, "--range", "7"}, "there are frames 0 to 1", 3},
                         {{in(), out, "--cut-at", "x"}, "--cut-at is \"x\""},
                         {{in(), out, "--cut-at", "7"}, "there are frames 0 to 1", 3},
                         {{in(), out, "--missing", "holt"}, "did you mean hold?"},
                         {{in(), out + "/#-#.png"}, "a pattern has one number"},
                         {{in(), out, "--lookahead", "17"}, "0 .. 16"},
                         {{in(), out, "--detect-cuts", "17"}, "0 .. 16"},
                         {{in(), out, "--server", "a:1,,b:1"}, "commas"},
                         {{in(), out, "--server", "nowhere:x"}, "neither HOST:PORT"},
                         {{in(), out, "--server", "127.0.0.1:1,nowhere:x"}, "neither HOST:PORT"},
                         {{in(), out, "--percentiles", "50,50.0000000001"}, "the first must be smaller"},
                         {{in(), std::string(300, 'a')}, "File name too long", 5},
                         {{in(), in() + "/./%04d.exr"}, "is one of the inputs"},
                         {{in(), out, "--server", "127.0.0.1:1", "--device", "0"}, "one of them"},
                         {{in(), out, "--exposure-plot", "plot.png"}, ".svg"},
                         {{in(), out, "--tier", "standart"}, "did you mean standard?"},
                         {{in() + "/nothing*.exr", out}, "no such file", 3},
                         {{folder_.path("nowhere"), out}, "no such file", 3},
                         {{in(), in() + "/%04d.exr"}, "is one of the inputs"}}) {
    std::vector<std::string> arguments{"stream"};
    arguments.insert(arguments.end(), c.arguments.begin(), c.arguments.end());
    const Outcome outcome = candela(arguments);
    EXPECT_EQ(outcome.code, c.code) << outcome.err;
    EXPECT_TRUE(says(outcome.err, c.words));
    EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  }
}

TEST_F(Stream, BenchMeasuresSessions) {
  const ListeningDaemon daemon;
  const std::vector<std::string> common{"bench",      "--server", daemon.address(), "--size", "64x64",
                                        "--sessions", "2"};
  std::vector<std::string> fast = common, paced = common;
  fast.insert(fast.end(), {"--seconds", "1"});
  paced.insert(paced.end(), {"--seconds", "2", "--fps", "10"});
  const Json fastest = candela_json(fast), steady = candela_json(paced);
  EXPECT_GT(fastest.at("frames"), 10);
  EXPECT_GT(fastest.at("fairness").at("jain"), 0.5);
  EXPECT_GE(fastest.at("latency_ms").at("p999"), fastest.at("latency_ms").at("p50"));
  EXPECT_EQ(fastest.at("window_fps").size(), 10u);
  EXPECT_EQ(fastest.at("failed"), 0);
  // Results that arrive after the end are not counted.
  const int due = steady.at("frames").get<int>() + steady.at("dropped").get<int>();
  EXPECT_LE(due, 40) << steady;
  EXPECT_GE(due, 30) << steady;
  const Outcome text = candela(fast);
  ASSERT_EQ(text.code, 0) << text.err;
  for (const char* word : {"throughput", "latency", "queue wait", "p99.9", "Jain", "dropped", "stable"}) {
    EXPECT_TRUE(says(text.out, word));
  }
}

}  // namespace
}  // namespace candela
