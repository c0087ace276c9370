// `candela render` of PNG and AVIF files: an intentional SDR picture of PQ and HLG.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <string>
#include <vector>

#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

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
    EXPECT_TRUE(says(report["notes"].dump(), "PQ: 1 is reference white, 203 nit; exposure is 0 EV"))
        << report["notes"];
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
  candela({"render", pq_, out_, "--bloom", "conserve", "-q"});
  EXPECT_NE(read_file(out_), plain);
  const auto srgb = candela_json({"render", pq_, out_, "--input-transfer", "srgb"});
  EXPECT_NE(srgb["exposure"], 1.0);
  EXPECT_EQ(candela_json({"render", pq_, out_, "--primaries", "p3-d65"})["primaries"]["from"], "option");
}

TEST_F(SignalInput, AStreamShowsEachFrameAsItsKind) {
  ASSERT_EQ(candela({"render", pq_, out_, "-q"}).code, 0);
  const std::string pq = read_file(out_);
  for (const int frame : {1, 2})
    write_file(folder_.path("shot." + std::to_string(frame) + ".png"), read_file(pq_));
  ASSERT_EQ(candela({"stream", folder_.path("shot.#.png"), folder_.path("o_%d.png"), "-q"}).code, 0);
  EXPECT_EQ(read_file(folder_.path("o_2.png")), pq);
  // Metering still meters, and whoever asks for metering in a picture gets it.
  EXPECT_NE(candela_json({"meter", pq_})["exposure"], 1.0);
  EXPECT_NE(candela_json({"render", pq_, out_, "--key", "0.3"})["exposure"], 1.0);
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
    const auto codes = candela_json({"render", pq_, out_, "--input-transfer", transfer, "--primaries",
                                     "rec2020", "--exposure", "0", "--bloom-intensity", "0"});
    const std::string expected = read_file(out_);
    const auto report = candela_json({"render", values, out_, "--input-transfer", transfer, "--primaries",
                                      "rec2020", "--exposure", "0", "--bloom-intensity", "0"});
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
