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
           {{"out.png", "--source-peak", "1000"}, "only bt2390 and shoulder have a source's peak"},
           {{"out.png", "--curve", "shoulder", "--transfer", "pq"}, "HDR displays have the curves"},
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

// `candela render` of PNG and AVIF files: an intentional SDR picture of PQ and HLG.

constexpr uint32_t kRampWidth = 256;

// Nit of a PQ signal: SMPTE ST 2084.
double pq_nits(double signal) {
  const double p = std::pow(signal, 32.0 / 2523);
  return 10000 *
         std::pow(std::max(p - 3424.0 / 4096, 0.0) / (2413.0 / 128 - 2392.0 / 128 * p), 16384.0 / 2610);
}

class SignalInput : public ::testing::Test {
 protected:
  // A ramp of colours as PQ codes, and the same light as a PFM.
  SignalInput() {
    std::string row, light;
    for (uint32_t x = 0; x < kRampWidth; ++x) {
      for (const uint32_t k : {1u, 2u, 3u}) {
        const uint32_t code = 255 * x / k;
        row += {static_cast<char>(code >> 8), static_cast<char>(code)};
        const auto v = static_cast<float>(pq_nits(code / 65535.0) / 203);
        light.append(reinterpret_cast<const char*>(&v), sizeof v);
      }
    }
    write_file(pq_, png_of(kRampWidth, 16, 2, row, cicp(9, 16)));
    write_file(light_, "PF\n256 1\n-1.0\n" + light);
  }

  const TemporaryFolder folder_;
  const std::string pq_ = folder_.path("pq.png");
  const std::string light_ = folder_.path("light.pfm");
  const std::string out_ = folder_.path("out.png");
};

TEST_F(SignalInput, PqIsShownAsItsLightAt0EvWithoutBloom) {
  for (const char* curve : {"aces-hill", "agx", "linear"}) {
    const auto report = candela_json({"render", pq_, out_, "--curve", curve});
    EXPECT_EQ(report["exposure"], 1.0);
    EXPECT_EQ(report["primaries"]["name"], "Rec.2020");
    EXPECT_EQ(report["primaries"]["from"], "file");
    EXPECT_TRUE(says(report["notes"].dump(), "PQ: 1 is reference white, 203 nit")) << report["notes"];
    const Png shown = read_png(out_);
    ASSERT_EQ(candela({"render", light_, out_, "--curve", curve, "--primaries", "rec2020", "--exposure", "0",
                       "--bloom-intensity", "0", "-q"})
                  .code,
              0);
    const Png expected = read_png(out_);
    for (uint32_t x = 0; x < kRampWidth; ++x) {
      for (int k = 0; k < 3; ++k)
        ASSERT_NEAR(shown.code(x, 0, k), expected.code(x, 0, k), 1) << curve << " " << x;
    }
  }
}

TEST_F(SignalInput, WhatIsGivenCounts) {
  const auto metered = candela_json({"render", pq_, out_, "--exposure", "auto"});
  EXPECT_NE(metered["exposure"], 1.0);
  EXPECT_EQ(candela_json({"render", pq_, out_, "--exposure", "2"})["exposure"], 4.0);
  const std::string plain = (candela({"render", pq_, out_, "-q"}), read_file(out_));
  candela({"render", pq_, out_, "--bloom", "conserve", "--bloom-intensity", "1", "-q"});
  EXPECT_NE(read_file(out_), plain);
  EXPECT_EQ(candela_json({"render", pq_, out_, "--input-transfer", "srgb"})["curve"], "linear");
  EXPECT_EQ(candela_json({"render", pq_, out_, "--primaries", "p3-d65"})["primaries"]["from"], "option");
}

TEST_F(SignalInput, AStreamShowsEachFrameAsItsKind) {
  ASSERT_EQ(candela({"render", pq_, out_, "-q"}).code, 0);
  const std::string pq = read_file(out_);
  for (const int frame : {1, 2})
    write_file(folder_.path("shot." + std::to_string(frame) + ".png"), read_file(pq_));
  ASSERT_EQ(candela({"stream", folder_.path("shot.#.png"), folder_.path("o_%d.png"), "-q"}).code, 0);
  EXPECT_EQ(read_file(folder_.path("o_2.png")), pq);
  // Whoever asks for metering gets it.
  EXPECT_NE(candela_json({"meter", pq_, "--exposure", "auto"})["exposure"], 1.0);
  EXPECT_EQ(candela_json({"render", pq_, out_, "--key", "0.3"})["exposure"], 1.0);
  EXPECT_NE(candela_json({"render", pq_, out_, "--previous-exposure", "3"})["exposure"], 1.0);
}

TEST_F(SignalInput, HlgIsMeantForADisplay) {
  const std::string hlg = folder_.path("hlg.png");
  write_file(hlg, png_of(1, 8, 0, "\xbf", cicp(9, 18)));
  const auto code = [&](const std::vector<std::string>& more) {
    std::vector<std::string> all = {"render", hlg, out_, "--curve", "linear", "-q"};
    all.insert(all.end(), more.begin(), more.end());
    EXPECT_EQ(candela(all).code, 0);
    return read_png(out_).code(0, 0, 0);
  };
  EXPECT_NEAR(code({}), 255, 1);  // 75 % is reference white
  EXPECT_LT(code({"--hlg-peak", "400"}), 190);
  // Blue has the luminance that the primaries of --primaries give it, not that of the file's.
  write_file(hlg, png_of(1, 8, 2, {'\0', '\0', '\x80'}, cicp(9, 18)));
  const std::string pfm = folder_.path("out.pfm");
  ASSERT_EQ(candela({"render", hlg, pfm, "--curve", "linear", "--primaries", "rec709", "-q"}).code, 0);
  const std::string bytes = read_file(pfm);
  float blue = 0;
  std::memcpy(&blue, bytes.data() + bytes.size() - sizeof blue, sizeof blue);
  const double scene = std::pow(128 / 255.0, 2) / 3;
  const double expected = 1000 / 203.0 * std::pow(0.0721923 * scene, 0.2) * scene;
  EXPECT_NEAR(blue, expected, 1e-3 * expected);
  EXPECT_EQ(candela({"render", hlg, out_, "--hlg-peak", "100"}).code, 2);
}

TEST_F(SignalInput, AnSdrPictureComesBackAsItWas) {
  const std::string sdr = folder_.path("sdr.png");
  std::string row;
  for (int x = 0; x < 256; ++x)
    row += {static_cast<char>(x), static_cast<char>(255 - x), static_cast<char>(x / 2)};
  write_file(sdr, png_of(kRampWidth, 8, 2, row));
  ASSERT_EQ(
      candela({"render", sdr, out_, "--curve", "linear", "--exposure", "0", "--bloom-intensity", "0", "-q"})
          .code,
      0);
  const Png shown = read_png(out_);
  for (int x = 0; x < 256; ++x) {
    EXPECT_EQ(shown.code(x, 0, 0), x);
    EXPECT_EQ(shown.code(x, 0, 1), 255 - x);
    EXPECT_EQ(shown.code(x, 0, 2), x / 2);
  }
}

TEST_F(SignalInput, AnAvifIsAnOutputAndThenAnInput) {
  const std::string fine = folder_.path("fine.avif"), coarse = folder_.path("coarse.avif"),
                    more = folder_.path("more") + "/";
  const std::vector<std::string> render = {"render", light_, out_, "--primaries", "rec2020", "-q"};
  ASSERT_EQ(candela(render).code, 0);
  for (const auto& [file, quality] : {std::pair(fine, "100"), {coarse, "5"}}) {
    ASSERT_EQ(candela({"render", light_, file, "--primaries", "rec2020", "--quality", quality, "-q"}).code,
              0);
  }
  EXPECT_LT(read_file(coarse).size(), read_file(fine).size());
  EXPECT_TRUE(says(candela({"info", fine}).out, "10 bits, sRGB, from nclx"));
  // As it was shown, to a code or two of 8 bits.
  ASSERT_EQ(candela({"render", fine, coarse, more, "--as", "png", "--curve", "linear", "--exposure", "0",
                     "--bloom-intensity", "0", "-q"})
                .code,
            0);
  const Png shown = read_png(out_), back = read_png(more + "fine.png");
  for (uint32_t x = 0; x < kRampWidth; ++x) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(back.code(x, 0, c), shown.code(x, 0, c), 2) << x;
  }
  // Also of gamma 2.2.
  ASSERT_EQ(candela({"render", light_, out_, "--primaries", "rec2020", "--transfer", "gamma22", "-q"}).code,
            0);
  const std::string gamma = folder_.path("gamma.avif");
  ASSERT_EQ(candela({"render", light_, gamma, "--primaries", "rec2020", "--transfer", "gamma22", "--quality",
                     "100", "-q"})
                .code,
            0);
  EXPECT_TRUE(says(candela({"info", gamma}).out, "10 bits, gamma 2.2, from nclx"));
  ASSERT_EQ(candela({"render", gamma, more, "--as", "png", "--curve", "linear", "--exposure", "0",
                     "--bloom-intensity", "0", "--transfer", "gamma22", "-q"})
                .code,
            0);
  const Png powers = read_png(out_), powers_back = read_png(more + "gamma.png");
  for (uint32_t x = 0; x < kRampWidth; ++x) {
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(powers_back.code(x, 0, c), powers.code(x, 0, c), 2) << x;
  }
  const Outcome missing = candela({"render", fine, folder_.path("none.avif"), more});
  EXPECT_EQ(missing.code, 2);
  EXPECT_TRUE(says(missing.err, "none.avif is no image that candela can read"));
  EXPECT_TRUE(says(candela({"render", light_, fine, "--bits", "16"}).err, "fine.avif has its own depth"));
  EXPECT_TRUE(says(candela({"render", light_, fine, "--bits", "8"}).err, "--bits changes nothing"));
}

TEST_F(SignalInput, InfoAndPatternsTakeThem) {
  const Outcome info = candela({"info", pq_});
  EXPECT_TRUE(says(info.out, "pq.png: PNG")) << info.out;
  EXPECT_TRUE(says(info.out, "16 bits, PQ, from cICP")) << info.out;
  ASSERT_EQ(candela({"render", pq_, out_, "-q"}).code, 0);
  EXPECT_EQ(candela({"render", folder_.path("pq*.png"), folder_.path("more") + "/", "-q"}).code, 0);
  EXPECT_EQ(read_file(folder_.path("more/pq.png")), read_file(out_));
}

// The ramp as numbers, such as what a program makes that writes a display's signal to an OpenEXR or PFM file.
TEST_F(SignalInput, NumbersAreThePictureThatTheSameCodesAre) {
  const std::string values = folder_.path("values.pfm");
  std::string signal;
  for (uint32_t x = 0; x < kRampWidth; ++x) {
    for (const uint32_t k : {1u, 2u, 3u}) {
      const auto v = static_cast<float>(255 * x / k / 65535.0);
      signal.append(reinterpret_cast<const char*>(&v), sizeof v);
    }
  }
  write_file(values, "PF\n256 1\n-1.0\n" + signal);
  for (const char* transfer : {"pq", "hlg", "srgb", "gamma22", "linear"}) {
    const auto codes =
        candela_json({"render", pq_, out_, "--input-transfer", transfer, "--primaries", "rec2020",
                      "--exposure", "0", "--bloom-intensity", "0", "--curve", "agx"});
    const std::string expected = read_file(out_);
    const auto report =
        candela_json({"render", values, out_, "--input-transfer", transfer, "--primaries", "rec2020",
                      "--exposure", "0", "--bloom-intensity", "0", "--curve", "agx"});
    EXPECT_EQ(read_file(out_), expected) << transfer;
    EXPECT_EQ(report["notes"].size(), codes["notes"].size()) << report["notes"];
  }
  // By itself it is at 0 EV, and in Rec.2020.
  const auto report = candela_json({"render", values, out_, "--input-transfer", "pq"});
  EXPECT_EQ(report["exposure"], 1.0);
  EXPECT_EQ(report["primaries"]["name"], "Rec.2020");
  EXPECT_NE(candela_json({"render", values, out_, "--input-transfer", "srgb"})["exposure"], 1.0);
}

}  // namespace
}  // namespace candela
