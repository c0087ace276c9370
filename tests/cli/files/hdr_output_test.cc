// `candela render` and `stream` into PQ and HLG: files, what they say, and their way back.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

const std::vector<std::string> kStill = {"--exposure", "0", "--bloom-intensity", "0", "-q"};

class HdrOutput : public ::testing::Test {
 protected:
  // Greys and colours of 0.1 to 1000 nit, 203 nit being 1.
  HdrOutput() {
    std::string light;
    for (int x = 0; x < kWidth; ++x) {
      for (const int k : {1, 2, 3}) {
        const float v =
            static_cast<float>(0.1 * std::pow(10.0, 4.0 * x / (kWidth - 1)) / 203 / (x % 2 == 0 ? 1 : k));
        light.append(reinterpret_cast<const char*>(&v), sizeof v);
      }
    }
    write_file(light_, "PF\n" + std::to_string(kWidth) + " 1\n-1.0\n" + light);
  }

  std::string path(const std::string& name) const { return folder_.path(name); }
  // The chunk's data, as large as `bytes`; "" if the file has none.
  static std::string chunk(const std::string& file, const std::string& name, size_t bytes) {
    const std::string text = read_file(file);
    const size_t at = text.find(name);
    return at == std::string::npos ? "" : text.substr(at + 4, bytes);
  }
  static uint32_t number(const std::string& bytes, size_t at) {
    uint32_t value = 0;
    for (size_t i = 0; i < 4; ++i) value = value << 8 | static_cast<unsigned char>(bytes.at(at + i));
    return value;
  }

  static constexpr int kWidth = 101;
  const TemporaryFolder folder_;
  const std::string light_ = folder_.path("light.pfm");
};

TEST_F(HdrOutput, APngNamesItsDisplayAndHowBrightItIs) {
  const auto report =
      candela_json(with({"render", light_, path("out.png"), "--transfer", "pq", "--peak", "4000"}, kStill));
  EXPECT_EQ(report["curve"], "bt2390");
  EXPECT_NEAR(report["max_light_nits"].get<double>(), 1000, 0.5);
  EXPECT_EQ(png_facts(path("out.png")).bits, 16);
  EXPECT_EQ(chunk(path("out.png"), "cICP", 4), std::string("\x09\x10\x00\x01", 4));
  const std::string display = chunk(path("out.png"), "mDCV", 24);
  EXPECT_EQ(number(display, 16), 4000u * 10000);
  const std::string light = chunk(path("out.png"), "cLLI", 8);
  EXPECT_NEAR(number(light, 0), 1000 * 1e4, 5e3);
  EXPECT_NEAR(number(light, 4), report["mean_light_nits"].get<double>() * 1e4, 1);
  // The server's own PNG of a session says the same.
  write_file(path("in.1.pfm"), read_file(light_));
  ASSERT_EQ(candela(with({"stream", path("in.#.pfm"), path("o.%d.png"), "--transfer", "pq", "--peak", "4000",
                          "--encoding", "png"},
                         kStill))
                .code,
            0);
  for (const char* name : {"cICP", "mDCV", "cLLI"}) {
    EXPECT_EQ(chunk(path("o.1.png"), name, 8), chunk(path("out.png"), name, 8)) << name;
  }
  EXPECT_EQ(chunk(path("out.png"), "sRGB", 1), "");
}

// Light that is shown as it is comes back, in every file that names its transfer.
TEST_F(HdrOutput, LightComesBack) {
  const std::vector<float> light = pfm_values(light_);
  for (const char* transfer : {"pq", "hlg"}) {
    for (const std::string file : {"out.png", "out.avif"}) {
      for (const char* primaries : {"rec2020", "p3-d65"}) {
        std::vector<std::string> words = {"render", light_,    path(file), "--transfer",
                                          transfer, "--curve", "linear",   "--display-primaries",
                                          primaries};
        if (file == "out.avif") words.insert(words.end(), {"--quality", "100"});
        ASSERT_EQ(candela(with(words, kStill)).code, 0);
        ASSERT_EQ(
            candela(with({"render", path(file), path("back.pfm"), "--curve", "linear", "--prescale", "0.125"},
                         kStill))
                .code,
            0);
        const std::vector<float> back = pfm_values(path("back.pfm"));
        ASSERT_EQ(back.size(), light.size());
        for (size_t i = 0; i < light.size(); ++i) {
          // Codes of 16 bits and halves, or of 10 bits, of which HLG's are coarse in the dark.
          const double least = file == "out.png" ? 2e-3 : 0.03;
          EXPECT_NEAR(back[i] * 8, light[i], least * light[i] + (file == "out.png" ? 1e-4 : 4e-3))
              << file << " " << transfer << " " << primaries << " " << i;
        }
      }
    }
  }
}

// A JPEG with a gain map is the plain one for others, and its light is read back.
TEST_F(HdrOutput, AJpegMayHaveAGainMap) {
  const std::string wide = path("wide.exr");
  ASSERT_EQ(candela({"sample", wide, "--size", "320x180", "-q"}).code, 0);
  const std::vector<std::string> look = {"--exposure", "1", "-q"};
  ASSERT_EQ(candela(with({"render", wide, path("plain.jpg")}, look)).code, 0);
  ASSERT_EQ(candela(with({"render", wide, path("hdr.jpg"), "--gain-map", "1000"}, look)).code, 0);
  const std::string plain = read_file(path("plain.jpg")), hdr = read_file(path("hdr.jpg"));
  const size_t scan = plain.find("\xff\xda");
  ASSERT_NE(scan, std::string::npos);
  EXPECT_NE(hdr.find(plain.substr(scan)), std::string::npos) << "the base's scans";
  EXPECT_NE(hdr.find("urn:iso:std:iso:ts:21496:-1"), std::string::npos);
  // A session's JPEGs have one, too, whoever encodes them.
  write_file(path("in.1.exr"), read_file(wide));
  for (const char* encoding : {"raw", "jpeg"}) {
    ASSERT_EQ(candela(with({"stream", path("in.#.exr"), path("s.%d.jpg"), "--gain-map", "1000", "--encoding",
                            encoding},
                           look))
                  .code,
              0);
    EXPECT_NE(read_file(path("s.1.jpg")).find("urn:iso:std:iso:ts:21496:-1"), std::string::npos) << encoding;
  }
  // The light: the SDR image's where it is dark, and more where it is bright, up to the peak.
  const std::vector<std::string> linear = {
      "--curve", "linear", "--prescale", "0.125", "--exposure", "0", "--bloom-intensity", "0", "-q"};
  ASSERT_EQ(candela(with({"render", path("plain.jpg"), path("sdr.pfm")}, linear)).code, 0);
  ASSERT_EQ(candela(with({"render", path("hdr.jpg"), path("light.pfm2.pfm")}, linear)).code, 0);
  const std::vector<float> sdr = pfm_values(path("sdr.pfm")), light = pfm_values(path("light.pfm2.pfm"));
  ASSERT_EQ(sdr.size(), light.size());
  double brightest = 0;
  size_t same = 0;
  for (size_t i = 0; i < sdr.size(); ++i) {
    EXPECT_GE(light[i], sdr[i] * 0.98 - 1e-4);
    same += std::abs(light[i] - sdr[i]) <= 0.03 * sdr[i] + 1e-4;
    brightest = std::max<double>(brightest, 8 * light[i]);
  }
  EXPECT_GT(same, sdr.size() / 4);
  EXPECT_GT(brightest, 3.5);
  EXPECT_LE(brightest, 1000.0 / 203 * 1.02);
  for (const char* out : {"no.png", "no.avif", "no.mp4"}) {
    const Outcome refused = candela({"stream", path("in.#.exr"), path(out), "--gain-map", "1000"});
    EXPECT_EQ(refused.code, 2) << refused.err;
  }
  EXPECT_EQ(candela({"render", wide, path("no.jpg"), "--gain-map", "100"}).code, 2);
}

// The light of a gain map of three channels is that of the HDR picture itself, within JPEG's own loss.
TEST_F(HdrOutput, AGainMapMayLeadToAnotherRendering) {
  const std::string wide = path("wide.exr");
  ASSERT_EQ(candela({"sample", wide, "--size", "320x180", "-q"}).code, 0);
  const std::vector<std::string> light = {
      "--curve", "linear", "--prescale", "0.0625", "--exposure", "0", "--bloom-intensity", "0", "-q"};
  struct Case {
    std::string curve, hdr_curve, peak;
    double white_nits;  // of the base
  };
  // ACES 2.0 shows a grey of 0.18 with 14.511552 nit at 1000, 13.192876 at 500, and 9.999933 in SDR.
  for (const Case& c :
       {Case{"aces-2", "aces-2", "1000", 145.11649}, Case{"aces-hill", "aces-2", "500", 131.92964},
        Case{"aces-hill", "bt2390", "1000", 203}, Case{"agx", "bt2390", "400", 203}}) {
    const std::string what = c.curve + " " + c.hdr_curve + " " + c.peak;
    const std::vector<std::string> look = {"--curve", c.curve, "--exposure", "1", "--quality", "98"};
    ASSERT_EQ(candela(with({"render", wide, path("plain.jpg"), "-q"}, look)).code, 0);
    const auto report = candela_json(
        with({"render", wide, path("hdr.jpg"), "--gain-map", c.peak, "--hdr-curve", c.hdr_curve, "--verify"},
             look));
    const std::string plain = read_file(path("plain.jpg")), hdr = read_file(path("hdr.jpg"));
    EXPECT_NE(hdr.find(plain.substr(plain.find("\xff\xda"))), std::string::npos) << "the base's scans";
    EXPECT_LE(report["verify_gain_map"]["p99_stops"], 0.1) << what;
    EXPECT_GT(report["verify_gain_map"]["p99_stops"], 0) << what;

    ASSERT_EQ(candela({"render", wide, path("pq.png"), "--curve", c.hdr_curve, "--transfer", "pq", "--peak",
                       c.peak, "--display-primaries", "p3-d65", "--exposure", "1", "-q"})
                  .code,
              0);
    ASSERT_EQ(candela(with({"render", path("hdr.jpg"), path("map.pfm")}, light)).code, 0);
    ASSERT_EQ(candela(with({"render", path("pq.png"), path("pq.pfm")}, light)).code, 0);
    const std::vector<float> ours = pfm_values(path("map.pfm")), truth = pfm_values(path("pq.pfm"));
    ASSERT_EQ(ours.size(), truth.size());
    std::vector<double> stops;
    for (size_t i = 0; i < ours.size(); ++i) {
      const double expected = 16 * truth[i] * 203 / c.white_nits;
      stops.push_back(std::abs(std::log2((16 * ours[i] + 1.0 / 64) / (expected + 1.0 / 64))));
    }
    std::ranges::sort(stops);
    EXPECT_LE(stops[stops.size() / 2], 0.02) << what;
    EXPECT_LE(stops[stops.size() * 99 / 100], 0.2) << what;
  }
  // Both renderings have one exposure, whatever chooses it, and one size.
  for (const std::vector<std::string>& how : std::vector<std::vector<std::string>>{
           {"--previous-exposure", "0.5", "--elapsed", "0.1"}, {"--resize", "33x"}, {}}) {
    const auto report = candela_json(
        with({"render", wide, path("hdr.jpg"), "--gain-map", "1000", "--hdr-curve", "bt2390"}, how));
    const auto map = report["gain_map"];
    EXPECT_EQ(map["min_log2"].size(), 3u);
    EXPECT_LT(map["min_log2"][1], map["max_log2"][1]);
    EXPECT_GT(map["headroom_log2"], 0.1);
    // A component of Rec.709 may be above the peak of P3-D65's.
    EXPECT_LE(map["headroom_log2"], std::log2(1.225 * 1000 / 203) + 1e-3);
  }
  for (const auto& [words, said] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"--hdr-curve", "bt2390"}, "needs --gain-map"},
           {{"--hdr-curve", "aces-1", "--gain-map", "1000"}, "match, bt2390, aces-2"},
           {{"--hdr-curve", "aces-2", "--gain-map", "900"}, "500, 1000, 2000, 4000"},
           {{"--hdr-curve", "aces-2", "--gain-map", "500", "--transfer", "gamma22"}, "--transfer gamma22: "},
           {{"--hdr-curve", "bt2390", "--gain-map", "500", "--alpha", "straight"}, "--alpha straight: "},
           {{"--hdr-curve", "bt2390", "--gain-map", "500", "--lut", "a.cube"}, "--lut chooses a view"}}) {
    const Outcome refused = candela(with({"render", wide, path("no.jpg")}, words));
    EXPECT_EQ(refused.code, 2) << said;
    EXPECT_TRUE(says(refused.err, said)) << refused.err;
  }
}

// The parts of an error: of the image, and of a file that loses detail.
TEST_F(HdrOutput, VerifySaysWhatAFileLoses) {
  const std::string wide = path("wide.exr");
  ASSERT_EQ(candela({"sample", wide, "--size", "160x90", "-q"}).code, 0);
  double before = 0;
  for (const auto& [file, quality, most] : {std::tuple("a.avif", "100", 1.5), std::tuple("a.jpg", "98", 12.0),
                                            std::tuple("b.jpg", "30", 255.0)}) {
    const auto report = candela_json({"render", wide, path(file), "--verify", "--quality", quality});
    EXPECT_LE(report["verify"]["max_error_codes"], 0.5);
    const double mean = report["verify_file"]["mean_error_codes"];
    EXPECT_LE(report["verify_file"]["max_error_codes"], most) << file;
    EXPECT_GT(mean, before) << file;
    before = mean;
  }
  EXPECT_FALSE(candela_json({"render", wide, path("c.png"), "--verify"}).contains("verify_file"));
}

// One sum of all that an image loses on its way, with or without verification.
TEST_F(HdrOutput, TheErrorHasParts) {
  const std::string wide = path("wide.exr");
  ASSERT_EQ(candela({"sample", wide, "--size", "160x90", "-q"}).code, 0);
  struct Case {
    std::string file;
    std::vector<std::string> options;
    double dither, rounding;
    bool lossy;
  };
  const double wide_step = 255.0 / 65535;
  for (const Case& c :
       {Case{"a.png", {"--max-error", "0.5"}, 0, 0.5, false},
        Case{"b.png", {"--max-error", "0.5", "--dither"}, 1, 0.5, false},
        Case{"c.png", {"--max-error", "0.5", "--bits", "16"}, 0, wide_step / 2, false},
        Case{"d.png",
             {"--max-error", "0.5", "--transfer", "pq", "--curve", "linear", "--bloom-intensity", "0"},
             0,
             wide_step / 2,
             false},
        Case{"e.exr", {"--max-error", "0.5"}, 0, 255.0 / 4096, false},
        Case{"f.jpg", {"--max-error", "0.5"}, 0, 0.5, true},
        Case{"g.avif", {"--verify"}, 0, wide_step / 2, true}}) {
    std::vector<std::string> words = {"render", wide, path(c.file)};
    words.insert(words.end(), c.options.begin(), c.options.end());
    const auto report = candela_json(words);
    const auto& parts = report["error_parts"];
    const bool verified = c.options[0] == "--verify";
    EXPECT_EQ(parts["rendering_is"], verified ? "measured" : "proven") << c.file;
    const double rendering = parts["rendering"];
    if (verified) {
      EXPECT_EQ(rendering, report["verify_unrounded"]["max_error_codes"]);
    } else {
      EXPECT_LE(rendering, 0.5) << c.file;
      EXPECT_GT(rendering, 0) << c.file;
    }
    EXPECT_TRUE(parts["table"].is_null());
    EXPECT_DOUBLE_EQ(parts["dither"], c.dither) << c.file;
    EXPECT_DOUBLE_EQ(parts["rounding"], c.rounding) << c.file;
    ASSERT_EQ(parts["file"].is_null(), !c.lossy) << c.file;
    const double file = c.lossy ? parts["file"].get<double>() : 0.0;
    if (c.lossy) {
      EXPECT_EQ(file, report["verify_file"]["max_error_codes"]);
    }
    EXPECT_NEAR(parts["sum"], rendering + c.dither + c.rounding + file, 1e-12) << c.file;
  }
  EXPECT_FALSE(candela_json({"render", wide, path("h.jpg")}).contains("error_parts"));
  // What a file on standard output loses is not measured.
  const Outcome piped = candela({"render", wide, "-", "--as", "jpg", "--max-error", "0.5"});
  EXPECT_TRUE(says(piped.err, "before the file's own loss 0.5")) << piped.err;
  const Outcome said = candela({"render", wide, path("i.png"), "--max-error", "0.5"});
  EXPECT_TRUE(says(said.out, "error      at most 0.5")) << said.out;
  EXPECT_TRUE(says(said.out, "(proven), rounding 0.5")) << said.out;
}

TEST_F(HdrOutput, WhatDoesNotGoTogetherIsRefused) {
  for (const auto& [words, said] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"out.jpg", "--transfer", "pq"}, "--transfer pq: "},
           {{"out.tif", "--transfer", "hlg"}, "has no word for it; write .png or .avif"},
           {{"out.exr", "--transfer", "pq"}, "has no word for it"},
           {{"out.png", "--transfer", "pq", "--bits", "8"}, "would show bands with 8 bits"},
           {{"out.png", "--peak", "1000"}, "which is for HDR displays"},
           {{"out.png", "--curve", "bt2390"}, "which is for HDR displays"},
           {{"out.png", "--transfer", "pq", "--curve", "agx"}, "HDR displays have the curves"},
           {{"out.png", "--transfer", "hlg", "--peak", "300"}, "between 400 and 2000"},
           {{"out.png", "--transfer", "pq", "--peak", "20000"}, "--peak is 20000"},
           {{"out.png", "--transfer", "pq", "--source-peak", "500"}, "must not be lower"}}) {
    std::vector<std::string> command = {"render", light_, path(words[0])};
    command.insert(command.end(), words.begin() + 1, words.end());
    const Outcome outcome = candela(command);
    EXPECT_EQ(outcome.code, 2) << said;
    EXPECT_NE(outcome.err.find(said), std::string::npos) << outcome.err;
    EXPECT_FALSE(std::filesystem::exists(path(words[0])));
  }
}

}  // namespace
}  // namespace candela
