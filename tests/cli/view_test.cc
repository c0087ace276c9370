// `candela view` and the panorama of `candela sample`.
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <thread>

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

class PanoramaView : public StreamFixture {
 protected:
  void SetUp() override {
    ASSERT_EQ(candela({"sample", "--panorama", pano_, "--size", "256x128", "-q"}).code, 0);
  }

  std::vector<std::string> command(const std::string& out, const std::vector<std::string>& options) const {
    std::vector<std::string> words =
        with({"view", pano_, folder_.path(out), "-q", "--size", "64x48"}, options);
    return words;
  }

  // The bytes of the picture that is rendered with these additional options.
  std::string picture(const std::vector<std::string>& options, const std::string& out = "out.png") {
    const Outcome outcome = candela(command(out, options));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    return read_file(folder_.path(out));
  }

  // The display-linear light of the pixel at this share of the width and height.
  std::array<float, 3> light(std::vector<std::string> options, double x, double y) {
    options.insert(options.end(), {"--bloom-intensity", "0"});
    picture(options, "light.pfm");
    const absl::StatusOr<Image> image = read_image(folder_.path("light.pfm"));
    EXPECT_OK(image);
    std::array<float, 3> rgb{};
    if (!image.ok()) return rgb;
    const auto column = static_cast<uint64_t>(x * image->width),
               row = static_cast<uint64_t>(y * image->height);
    std::memcpy(rgb.data(), image->pixels.data() + row * image->row_bytes() + column * 16, sizeof rgb);
    return rgb;
  }

  // The colour of the wall there: 'r', 'g', 'b', 'y', or '?'.
  char wall(const std::vector<std::string>& options, double x = 0.5, double y = 0.45) {
    const auto [r, g, b] = light(options, x, y);
    if (b > 2 * r && b > 2 * g) return 'b';
    if (g > 2 * r && g > 2 * b) return 'g';
    if (r > 2 * g && r > 2 * b) return 'r';
    return r > 2 * b && g > 2 * b ? 'y' : '?';
  }

  // The lines of a sequence: one for each frame, then the summary.
  std::vector<Json> sequence(std::vector<std::string> options, const std::string& out = "out/%04d.png") {
    options.insert(options.end(), {"--json", "-"});
    const Outcome outcome = candela(command(out, options));
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    return lines_of(outcome.out);
  }

  Outcome refused(const std::vector<std::string>& options, int code, const std::string& out = "out.png") {
    const Outcome outcome = candela(command(out, options));
    EXPECT_EQ(outcome.code, code) << outcome.err;
    return outcome;
  }

  const std::string pano_ = folder_.path("pano.exr");
};

TEST_F(PanoramaView, YawTurnsTheCameraToTheRight) {
  EXPECT_EQ(wall({}), 'r');
  EXPECT_EQ(wall({"--yaw", "90"}), 'g');
  EXPECT_EQ(wall({"--yaw", "180"}), 'b');
  EXPECT_EQ(wall({"--yaw", "-90"}), 'y');
}

TEST_F(PanoramaView, RotationOf90MovesWhatWasAheadToTheLeft) {
  EXPECT_EQ(wall({"--rotation", "90"}), 'g');
  EXPECT_EQ(wall({"--rotation", "90", "--yaw", "-90"}), 'r');
}

TEST_F(PanoramaView, AChromeBallMirrorsTheRightWayRound) {
  write_file(
      folder_.path("ball.json"),
      R"({"objects":[{"centre":[0,0,-3],"radius":1,"base_color":[1,1,1],"metallic":1,"roughness":0}]})");
  const std::vector<std::string> ball{"--objects", folder_.path("ball.json"), "--size", "256x256", "--fov",
                                      "50"};
  // A ray that meets the ball where its normal is 37.3 degrees from the axis leaves it at a right angle to
  // the axis.
  const double side = 0.294;
  EXPECT_EQ(wall(ball, 0.5, 0.47), 'b');         // it shows what is behind the camera
  EXPECT_EQ(wall(ball, 0.5 - side, 0.47), 'y');  // and to its left what is to the left
  EXPECT_EQ(wall(ball, 0.5 + side, 0.47), 'g');
}

TEST_F(PanoramaView, TheSameViewHasTheSameBitsHereAndOnADaemon) {
  const ListeningDaemon daemon;
  const std::string here = picture({"--objects", "lookdev"}, "a.png");
  EXPECT_TRUE(here == picture({"--objects", "lookdev", "--server", daemon.address()}, "b.png"));
  EXPECT_TRUE(here ==
              picture({"--objects", "lookdev", "--server", "127.0.0.1:1," + daemon.address()}, "c.png"));
}

TEST_F(PanoramaView, TheJsonNamesTheEnvironmentAndThePrimariesOfThePanorama) {
  std::vector<std::string> words = command("out.png", {});
  const Json plain = candela_json(words);
  EXPECT_EQ(plain.at("environment").get<std::string>().size(), 64u);
  EXPECT_EQ(plain.at("size").at("width"), 64);
  EXPECT_EQ(plain.at("primaries").at("from"), "file");
  words.insert(words.end(), {"--primaries", "rec2020"});
  const Json wide = candela_json(words);
  EXPECT_EQ(wide.at("primaries").at("name"), "Rec.2020");
  EXPECT_NE(wide.at("environment"), plain.at("environment"));
}

TEST_F(PanoramaView, WhatViewsAreMadeFromIsAStageOfTheFirstThatNeedsIt) {
  const ListeningDaemon daemon;
  const auto bakes = [&](const std::vector<std::string>& options) {
    std::vector<std::string> words = command("out.png", {"--server", daemon.address()});
    words.insert(words.end(), options.begin(), options.end());
    const Json times = candela_json(words).at("stage_ms");
    return times.contains("bake") && times.at("bake").get<double>() > 0;
  };
  EXPECT_TRUE(bakes({}));
  EXPECT_FALSE(bakes({"--yaw", "90"}));
  EXPECT_TRUE(bakes({"--objects", "lookdev"}));
  EXPECT_FALSE(bakes({"--objects", "lookdev"}));
}

TEST_F(PanoramaView, EveryKindOfOutputIsWritten) {
  picture({"--bits", "16"}, "deep.png");
  EXPECT_EQ(png_facts(folder_.path("deep.png")).bits, 16);
  EXPECT_FALSE(png_facts(folder_.path("deep.png")).alpha);
  EXPECT_EQ(picture({}, "a.jpg").substr(0, 2), "\xff\xd8");
  EXPECT_TRUE(read_image(folder_.path("a.exr")).status().code() == absl::StatusCode::kNotFound);
  picture({}, "a.exr");
  EXPECT_OK(read_image(folder_.path("a.exr")));
}

TEST_F(PanoramaView, AVerifiedViewIsWithinTheBoundOfItsTier) {
  std::vector<std::string> words = command("out.png", {"--objects", "lookdev", "--error-map"});
  words.push_back(folder_.path("map.png"));
  const Json verified = candela_json(words);
  EXPECT_LE(verified.at("verify").at("max_error_codes").get<double>(), 0.01);
  EXPECT_GT(verified.at("verify_unrounded").at("max_error_codes").get<double>(), 0);
  EXPECT_GT(png_facts(folder_.path("map.png")).width, 64u);
  EXPECT_FALSE(candela_json(command("out.png", {})).contains("verify"));
}

TEST_F(PanoramaView, ATurnEndsWhereItBeganAndFrameIsTheViewOfItsYaw) {
  const std::vector<Json> lines =
      sequence({"--turn", "360", "--frames", "4", "--fps", "4", "--exposure", "0"});
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_EQ(lines[2].at("media_time_ns"), 500'000'000);
  EXPECT_EQ(lines[4].at("summary").at("written"), 4);
  EXPECT_EQ(lines[4].at("summary").at("resumes"), 0);
  for (int i = 0; i < 4; ++i) {
    const std::string yaw = absl::StrFormat("%d", 90 * i);
    EXPECT_TRUE(image(absl::StrFormat("%04d.png", i)) == picture({"--yaw", yaw, "--exposure", "0"})) << i;
  }
}

TEST_F(PanoramaView, ExposureAdaptsOverTheMediaTimesOfASequence) {
  const std::vector<Json> lines = sequence({"--turn", "180", "--frames", "4", "--fps", "8", "--pitch", "20"});
  ASSERT_EQ(lines.size(), 5u);
  EXPECT_EQ(lines[0].at("exposure"), lines[0].at("target"));
  // The second frame looks at the sun, the last one away from it.
  EXPECT_LT(lines[1].at("target"), 0.95 * lines[0].at("target").get<double>());
  EXPECT_GT(lines[3].at("target"), 1.1 * lines[0].at("target").get<double>());
  for (size_t i = 1; i < 4; ++i) {
    const double exposure = lines[i].at("exposure"), target = lines[i].at("target");
    const double before = lines[i].at("exposure_before");
    EXPECT_EQ(before, lines[i - 1].at("exposure").get<double>());
    const double alpha = 1 - std::exp(-0.125 * (target > before ? 3 : 1));
    EXPECT_NEAR(std::log2(exposure), std::log2(before) + alpha * std::log2(target / before), 1e-9) << i;
  }
}

TEST_F(PanoramaView, APathGoesThroughItsKeysAndNeverBeyondThem) {
  write_file(folder_.path("keys.json"),
             R"({"keys":[{"time":0},{"time":0.5,"yaw":90},{"time":1,"yaw":90},{"time":1.5,"yaw":180}]})");
  const std::vector<Json> lines =
      sequence({"--path", folder_.path("keys.json"), "--fps", "4", "--exposure", "0"});
  ASSERT_EQ(lines.size(), 8u);  // up to the last key
  EXPECT_TRUE(image("0002.png") == picture({"--yaw", "90", "--exposure", "0"}));
  EXPECT_TRUE(image("0003.png") == image("0002.png"));  // it rests between equal keys
  EXPECT_TRUE(image("0006.png") == picture({"--yaw", "180", "--exposure", "0"}));
  EXPECT_TRUE(image("0001.png") != image("0000.png"));
}

TEST_F(PanoramaView, ASequenceHasTheSameBitsOnAServerThatLacksThePanorama) {
  const ListeningDaemon daemon;
  sequence({"--turn", "90", "--frames", "3"}, "here/%d.png");
  sequence({"--turn", "90", "--frames", "3", "--server", daemon.address()}, "there/%d.png");
  for (const char* name : {"0.png", "1.png", "2.png"})
    EXPECT_TRUE(image(name, "here") == image(name, "there"));
}

TEST_F(PanoramaView, ASequenceGoesOnOnAnotherServerWhichThenGetsThePanorama) {
  const std::vector<std::string> turn{"--turn", "360", "--frames", "60", "--size", "320x200"};
  sequence(turn, "whole/%d.png");
  // Both need the same keys, so that the second accepts the first one's tokens.
  write_file(folder_.path("keys"), "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n");
  std::filesystem::permissions(folder_.path("keys"), std::filesystem::perms::owner_read);
  ListeningDaemon first({"--resume-keys", folder_.path("keys")});
  const ListeningDaemon second({"--resume-keys", folder_.path("keys")});
  std::thread killer([&] {
    const std::string some = folder_.path("out/6.png");
    for (int i = 0; i < 2000 && !std::filesystem::exists(some); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    first.stop(SIGKILL);
  });
  std::vector<std::string> options = turn;
  options.insert(options.end(), {"--server", first.address() + "," + second.address()});
  const std::vector<Json> lines = sequence(options, "out/%d.png");
  killer.join();
  ASSERT_EQ(lines.size(), 61u);
  EXPECT_EQ(lines.back().at("summary").at("server"), second.address());
  for (int i = 0; i < 60; ++i) {
    const std::string name = absl::StrFormat("%d.png", i);
    EXPECT_TRUE(image(name) == image(name, "whole")) << name;
  }
}

TEST_F(PanoramaView, TheServerCanMakeTheFilesOfASequence) {
  sequence({"--turn", "90", "--frames", "2", "--encoding", "jpeg"}, "out/%d.jpg");
  EXPECT_EQ(image("1.jpg").substr(0, 2), "\xff\xd8");
  sequence({"--turn", "90", "--frames", "2", "--encoding", "png"}, "served");
  EXPECT_EQ(png_facts(folder_.path("served/0001.png")).width, 64u);
}

TEST_F(PanoramaView, APictureFarFromTwoToOneIsTakenWithANote) {
  write_small_exr(folder_.path("small.exr"));
  const Outcome outcome =
      candela({"view", folder_.path("small.exr"), folder_.path("o.png"), "--size", "8x8"});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_TRUE(says(outcome.err, "note:"));
  EXPECT_TRUE(says(outcome.err, "twice as wide as high"));
}

TEST_F(PanoramaView, WrongUseNamesTheOption) {
  for (const std::vector<std::string>& wrong : std::vector<std::vector<std::string>>{{"--fov", "171"},
                                                                                     {"--samples", "2"},
                                                                                     {"--yaw", "north"},
                                                                                     {"--rotation", "361"},
                                                                                     {"--turn", "x"}}) {
    EXPECT_TRUE(says(refused(wrong, 2).err, wrong[0]));
  }
  EXPECT_TRUE(says(refused({"--frames", "3"}, 2).err, "--turn"));
  EXPECT_TRUE(says(refused({"--turn", "3"}, 2).err, "single file"));
  EXPECT_TRUE(says(refused({"--turn", "3", "--path", "k"}, 2, "o%d.png").err, "--path"));
  EXPECT_TRUE(says(refused({"--turn", "3", "--verify"}, 2, "o%d.png").err, "--verify"));
  EXPECT_TRUE(says(refused({"--error-map", "map.jpg"}, 2).err, "map.jpg"));
  EXPECT_TRUE(says(refused({}, 2, "o%d.png").err, "--turn"));
  EXPECT_TRUE(says(refused({"--turn", "3", "--fps", "20000"}, 2, "o%d.png").err, "the limit is 100000"));
  EXPECT_TRUE(says(refused({}, 2, "pano.exr").err, "is the input"));
}

TEST_F(PanoramaView, AWrongFileOfObjectsOrKeysNamesItsMember) {
  const std::string file = folder_.path("file.json");
  const auto expect_refused = [&](const char* option, const char* text, const char* words) {
    write_file(file, text);
    const Outcome outcome = refused({option, file}, 3, std::string(option) == "--path" ? "o%d.png" : "o.png");
    EXPECT_TRUE(says(outcome.err, file));
    EXPECT_TRUE(says(outcome.err, words));
  };
  expect_refused("--objects", "[]", "no JSON object");
  expect_refused("--objects", R"({"objects":[{"center":[0,0,0],"radius":1}]})", "did you mean centre");
  expect_refused("--objects", R"({"objects":[{"centre":[0,0,-3],"radius":0}]})",
                 "objects[0].radius is 0; it must be a number, ");
  expect_refused("--objects", R"({"objects":[{"centre":[0,0,-3]}]})",
                 "objects[0].radius is missing; it must be a number, ");
  expect_refused("--objects", R"({"objects":[3]})", "objects[0] must be a JSON object");
  expect_refused("--path", R"({"keys":[{"time":1},{"time":1}]})", "keys[1].time");
  expect_refused("--path", R"({"keys":[{"time":0,"fov":0}]})", "keys[0].fov");
  expect_refused("--path", R"({"keys":[{"time":0},{"time":60000}]})", "the keys' times, which are seconds");
  write_file(file, R"({"objects":[{"centre":[0,0,0],"radius":1}]})");
  EXPECT_TRUE(says(refused({"--objects", file}, 3).err, "--objects[0]"));
}

}  // namespace
}  // namespace candela
