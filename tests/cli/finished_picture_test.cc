// Pictures of displays are left as they are: the table of docs/pipeline.md section 7.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "client/image/color.h"
#include "client/image/image.h"
#include "tests/cli/command.h"
#include "tests/cli/images.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

namespace candela {
namespace {

constexpr std::array<float, 8> kP3 = {0.680f, 0.320f, 0.265f, 0.690f, 0.150f, 0.060f, 0.3127f, 0.3290f};
const std::vector<std::string> kPictures = {"png", "jpg", "tif", "avif"};

std::string pfm_of(const std::vector<float>& greys) {
  std::string text = "PF\n" + std::to_string(greys.size()) + " 1\n-1.0\n";
  for (const float grey : greys) {
    for (int c = 0; c < 3; ++c) text.append(reinterpret_cast<const char*>(&grey), sizeof grey);
  }
  return text;
}

class FinishedPicture : public ::testing::Test {
 protected:
  static constexpr uint32_t kWidth = 256, kHeight = 64;

  std::string path(const std::string& name) const { return folder_.path(name); }

  // All greys in the first half of the rows; below them colours, dark and saturated ones among them.
  static Image codes() {
    Image image = *image_to_overwrite(kWidth, kHeight, ImageFormat::kRgba8);
    for (uint32_t y = 0; y < kHeight; ++y) {
      for (uint32_t x = 0; x < kWidth; ++x) {
        const bool grey = y < kHeight / 2;
        const std::array<uint8_t, 4> code = {static_cast<uint8_t>(x),
                                             static_cast<uint8_t>(grey ? x : 255 - x),
                                             static_cast<uint8_t>(grey ? x : 7 * y % 256), 255};
        std::memcpy(image.pixels.data() + y * image.row_bytes() + size_t{4} * x, code.data(), 4);
      }
    }
    return image;
  }
  // 16 bits, as AVIF is written from.
  static Image wide(const Image& image) {
    Image wide = *image_to_overwrite(image.width, image.height, ImageFormat::kRgba16);
    for (size_t i = 0; i < image.bytes(); ++i) {
      const auto code = static_cast<uint16_t>(257 * std::to_integer<uint16_t>(image.pixels.data()[i]));
      std::memcpy(wide.pixels.data() + 2 * i, &code, 2);
    }
    wide.has_alpha = image.has_alpha;
    return wide;
  }
  // The picture as a file of this kind, without a loss worth a code.
  std::string picture(const std::string& kind, const std::optional<std::array<float, 8>>& primaries = {},
                      Image image = codes()) {
    const std::string file = path("in_" + std::string(primaries ? "wide" : "srgb") + "." + kind);
    if (kind == "avif") image = wide(image);
    EXPECT_OK(write_image(file, image, {.primaries = primaries, .jpeg_quality = 100}));
    return file;
  }
  // The codes of a file, 0 .. 255.
  static std::vector<double> codes_of(const std::string& file) {
    const auto image = read_image(file, {}, {.keeps_signal = true});
    EXPECT_OK(image);
    if (!image.ok()) return {};
    std::vector<double> codes;
    for (size_t i = 0; i < size_t{4} * image->width * image->height; ++i) {
      float v;
      std::memcpy(&v, image->pixels.data() + sizeof v * i, sizeof v);
      codes.push_back(255.0 * v);
    }
    return codes;
  }
  static void expect_same_codes(const std::string& file, const std::string& other, double within = 1) {
    const std::vector<double> a = codes_of(file), b = codes_of(other);
    ASSERT_EQ(a.size(), b.size());
    double most = 0;
    for (size_t i = 0; i < a.size(); ++i) most = std::max(most, std::abs(a[i] - b[i]));
    EXPECT_LE(most, within + 1e-3) << file << " and " << other;
  }

  const TemporaryFolder folder_;
};

TEST_F(FinishedPicture, AnSdrPictureKeepsItsCodes) {
  for (const std::string& kind : kPictures) {
    const std::string in = picture(kind);
    const auto report = candela_json({"render", in, path("out.png")});
    EXPECT_EQ(report["exposure"], 1) << kind;
    EXPECT_EQ(report["curve"], "linear") << kind;
    EXPECT_EQ(report["notes"], nlohmann::json::array()) << kind;
    expect_same_codes(in, path("out.png"));
    for (const std::string& out : kPictures) {
      ASSERT_EQ(candela({"render", in, path("out." + out), "--quality", "100", "-q"}).code,
                out == "png" || out == "tif" ? 2 : 0);
    }
  }
}

TEST_F(FinishedPicture, AlphaIsKept) {
  Image image = codes();
  image.has_alpha = true;
  for (size_t i = 0; i < image.pixels.size(); i += 4)
    image.pixels.data()[i + 3] = std::byte{static_cast<uint8_t>(1 + i / 4 % 255)};
  const std::string in = picture("png", {}, std::move(image));
  ASSERT_EQ(candela({"render", in, path("out.png"), "-q"}).code, 0);
  expect_same_codes(in, path("out.png"));
}

TEST_F(FinishedPicture, EachDefaultGivesWayToItsOwnOptionAlone) {
  const std::string in = picture("png");
  const auto render = [&](const std::vector<std::string>& more) {
    return candela_json(with({"render", in, path("out.png")}, more));
  };
  EXPECT_EQ(render({"--exposure", "1"})["exposure"], 2);
  const std::vector<double> before = codes_of(in), after = codes_of(path("out.png"));
  for (size_t i = 0; i < before.size(); i += 4) {
    const double light = std::min(1.0, 2 * to_linear(ColorCurve::kSrgb, before[i] / 255));
    EXPECT_NEAR(to_linear(ColorCurve::kSrgb, after[i] / 255), light, 0.01) << "it brightens, and clips";
  }
  auto report = render({"--curve", "agx"});
  EXPECT_EQ(report["curve"], "agx");
  EXPECT_EQ(report["exposure"], 1);
  report = render({"--exposure", "auto"});
  EXPECT_EQ(report["curve"], "linear");
  EXPECT_NE(report["exposure"], 1);
  report = render({"--bloom-intensity", "0.2"});
  EXPECT_EQ(report["curve"], "linear");
  EXPECT_EQ(report["exposure"], 1);
  EXPECT_NE(report["plan"].dump().find("bloom"), std::string::npos);
  report = render({"--compensation", "1"});
  EXPECT_EQ(report["exposure"], 1);
  EXPECT_NE(report["notes"].dump().find("--exposure auto meters it"), std::string::npos);
}

TEST_F(FinishedPicture, SceneLightHasAllOfTheDefaults) {
  const std::string in = picture("png");
  const auto report = candela_json({"render", in, path("scene.png"), "--scene-light"});
  EXPECT_EQ(report["curve"], "aces-hill");
  EXPECT_NE(report["exposure"], 1);
  // The same light in a file of scene light.
  ASSERT_EQ(candela({"render", in, path("light.exr"), "-q"}).code, 0);
  ASSERT_EQ(candela({"render", path("light.exr"), path("exr.png"), "-q"}).code, 0);
  expect_same_codes(path("scene.png"), path("exr.png"));
}

TEST_F(FinishedPicture, ItsColoursStayWhereTheOutputCanHoldThem) {
  for (const std::string& kind : kPictures) {
    const std::string in = picture(kind, kP3);
    for (const std::string& out : kPictures) {
      const std::string file = path("out." + out);
      const bool lossy = out == "jpg" || out == "avif";
      ASSERT_EQ(candela(with({"render", in, file, "-q"}, lossy ? std::vector<std::string>{"--quality", "100"}
                                                               : std::vector<std::string>{}))
                    .code,
                0);
      expect_same_codes(in, file, lossy ? 4 : 1);
      const auto read = read_image(file);
      ASSERT_OK(read);
      ASSERT_TRUE(read->chromaticities) << kind << " to " << out;
      for (size_t i = 0; i < 8; ++i) EXPECT_NEAR((*read->chromaticities)[i], kP3[i], 1e-3) << out;
      EXPECT_EQ(read->light, PictureLight::kSdr);
    }
    // A curve works in Rec.709.
    ASSERT_EQ(candela({"render", in, path("agx.png"), "--curve", "agx", "-q"}).code, 0);
    EXPECT_FALSE(read_image(path("agx.png"))->chromaticities);
  }
}

TEST_F(FinishedPicture, PrimariesThatTheUserNamesAreItsOwn) {
  const std::string in = picture("png");
  for (const auto& [words, x] : {std::pair("p3-d65", 0.680), {"adobe-rgb", 0.64}}) {
    const auto report = candela_json({"render", in, path("out.png"), "--primaries", words});
    EXPECT_EQ(report["notes"], nlohmann::json::array()) << words;
    expect_same_codes(in, path("out.png"));
    const auto read = read_image(path("out.png"));
    ASSERT_OK(read);
    ASSERT_TRUE(read->chromaticities) << words;
    EXPECT_NEAR((*read->chromaticities)[0], x, 1e-3);
  }
  ASSERT_EQ(candela({"render", in, path("out.png"), "--primaries", "rec709", "-q"}).code, 0);
  EXPECT_FALSE(read_image(path("out.png"))->chromaticities);
}

TEST_F(FinishedPicture, ElsewhereItsColoursAreThoseOfRec709) {
  const std::string in = picture("png", kP3);
  const auto report = candela_json({"render", in, path("out.pfm")});
  EXPECT_NE(report["notes"].dump().find("were cut"), std::string::npos) << report["notes"];
  const auto image = read_image(in);
  ASSERT_OK(image);
  const std::vector<float> out = pfm_values(path("out.pfm"));
  constexpr double kToRec709[3][3] = {
      {1.2249402, -0.2249402, 0}, {-0.0420570, 1.0420570, 0}, {-0.0196376, -0.0786360, 1.0982736}};
  for (uint32_t y = 0; y < kHeight; ++y) {
    for (uint32_t x = 0; x < kWidth; ++x) {
      std::array<float, 4> p3;
      std::memcpy(p3.data(), image->pixels.data() + y * image->row_bytes() + sizeof p3 * x, sizeof p3);
      for (size_t c = 0; c < 3; ++c) {
        const double light = kToRec709[c][0] * p3[0] + kToRec709[c][1] * p3[1] + kToRec709[c][2] * p3[2];
        EXPECT_NEAR(out[3 * ((kHeight - 1 - y) * kWidth + x) + c], std::clamp(light, 0.0, 1.0), 1e-3);
      }
    }
  }
}

TEST_F(FinishedPicture, WhiteOfAnSdrPictureIs203NitOnAnHdrDisplay) {
  const std::string in = picture("png");
  for (const char* transfer : {"pq", "hlg"}) {
    const auto report = candela_json({"render", in, path("out.png"), "--transfer", transfer});
    EXPECT_EQ(report["curve"], "linear") << transfer;
    EXPECT_NEAR(report["max_light_nits"].get<double>(), 203, 0.1) << transfer;
  }
}

TEST_F(FinishedPicture, AnSdrPictureHasNoLightForAGainMap) {
  const std::string in = picture("jpg");
  for (const std::vector<std::string>& how :
       {std::vector<std::string>{"--gain-map", "1000"}, {"--gain-map", "1000", "--hdr-curve", "bt2390"}}) {
    const Outcome refused = candela(with({"render", in, path("out.jpg")}, how));
    EXPECT_EQ(refused.code, 3) << refused.err;
    EXPECT_NE(refused.err.find("in_srgb.jpg: it is an SDR picture"), std::string::npos) << refused.err;
    EXPECT_NE(refused.err.find("--scene-light"), std::string::npos) << refused.err;
    EXPECT_EQ(candela(with({"render", in, path("out.jpg"), "--scene-light", "-q"}, how)).code, 0);
  }
}

// Light up to the peak of 1000 nit, as greys.
class HdrPicture : public FinishedPicture {
 protected:
  static constexpr double kPeak = 1000.0 / 203;

  HdrPicture() {
    for (int i = 0; i < 200; ++i)
      light_.push_back(static_cast<float>(kPeak * std::pow(2.0, (i - 199) / 16.0)));
    light_.insert(light_.begin(), {0.02f, 0.18f, 0.4f});
    write_file(path("light.pfm"), pfm_of(light_));
    EXPECT_EQ(candela({"render", path("light.pfm"), in_, "--transfer", "pq", "--curve", "linear",
                       "--exposure", "0", "--bloom-intensity", "0", "-q"})
                  .code,
              0);
  }

  std::vector<float> light_;
  const std::string in_ = path("pq.png");
};

TEST_F(HdrPicture, OfAnHdrPictureOnlyLightAboveHalfOfWhiteChanges) {
  const auto report = candela_json({"render", in_, path("out.png")});
  EXPECT_EQ(report["curve"], "shoulder");
  EXPECT_EQ(report["exposure"], 1);
  const std::vector<double> codes = codes_of(path("out.png"));
  for (const auto& [at, code] : {std::pair(0, 39), {1, 118}, {2, 170}}) EXPECT_NEAR(codes[4 * at], code, 3);
  for (size_t i = 4; i < light_.size(); ++i) EXPECT_GE(codes[4 * i], codes[4 * (i - 1)]);
  EXPECT_NEAR(codes[4 * (light_.size() - 1)], 255, 0.01);
  EXPECT_LT(codes[4 * (light_.size() - 8)], 255) << "only the peak is white";
  // Others by name; the source's peak is the file's.
  const auto bt2390 = candela_json({"render", in_, path("out.png"), "--curve", "bt2390", "--verify"});
  EXPECT_EQ(bt2390["curve"], "bt2390");
  EXPECT_LT(bt2390["verify"]["max_error_codes"], 0.05);
  EXPECT_NEAR(codes_of(path("out.png"))[4 * (light_.size() - 1)], 255, 0.6);
  // Exposed darker, more of it is below white.
  ASSERT_EQ(candela({"render", in_, path("out.png"), "--exposure=-3", "-q"}).code, 0);
  const std::vector<double> dark = codes_of(path("out.png"));
  for (size_t i = 0; i < light_.size(); ++i)
    EXPECT_NEAR(to_linear(ColorCurve::kSrgb, dark[4 * i] / 255), light_[i] / 8, 0.004);
}

TEST_F(HdrPicture, ItsGainMapHasItsOwnLight) {
  ASSERT_EQ(candela({"render", in_, path("out.jpg"), "--gain-map", "1000", "--quality", "100", "-q"}).code,
            0);
  const auto back = read_image(path("out.jpg"));
  ASSERT_OK(back);
  EXPECT_EQ(back->light, PictureLight::kHdr);
  for (size_t i = 0; i < light_.size(); ++i) {
    float light;
    std::memcpy(&light, back->pixels.data() + 16 * i, sizeof light);
    // The base has codes of 8 bits, whose steps are large in the dark.
    EXPECT_NEAR(light, light_[i], 0.07 * light_[i] + 2e-4);
  }
}

TEST_F(HdrPicture, AnHdrDisplayThatShowsItsPeakShowsAllOfIt) {
  const auto report = candela_json({"render", in_, path("out.png"), "--transfer", "pq"});
  EXPECT_EQ(report["curve"], "linear");
  expect_same_codes(in_, path("out.png"), 0.1);
  EXPECT_EQ(candela_json({"render", in_, path("out.png"), "--transfer", "pq", "--peak", "400"})["curve"],
            "bt2390");
}

// By default a picture with a gain map is the SDR picture in its file.
TEST_F(HdrPicture, OfAPictureWithAGainMapItsBaseIsShown) {
  const std::string in = path("map.jpg"), base = path("base.jpg");
  ASSERT_EQ(candela({"render", in_, in, "--gain-map", "1000", "--curve", "agx", "-q"}).code, 0);
  ASSERT_EQ(candela({"render", in_, base, "--curve", "agx", "-q"}).code, 0);
  auto report = candela_json({"render", in, path("out.png")});
  EXPECT_EQ(report["curve"], "linear");
  expect_same_codes(path("out.png"), base);
  for (const std::vector<std::string>& look :
       {std::vector<std::string>{"--sdr", "curve"}, {"--exposure", "0"}, {"--curve", "shoulder"}}) {
    EXPECT_EQ(candela_json(with({"render", in, path("out.png")}, look))["curve"], "shoulder");
  }
  EXPECT_EQ(candela_json({"render", in, path("out.png"), "--exposure", "0", "--sdr", "base"})["curve"],
            "linear");
  EXPECT_EQ(candela_json({"render", in, path("out.png"), "--transfer", "pq"})["curve"], "linear");
  const auto light = read_image(in);
  ASSERT_OK(light);
  EXPECT_EQ(light->light, PictureLight::kHdr);
}

// Every command that shows pictures leaves them as they are.
TEST_F(FinishedPicture, OtherCommandsFollow) {
  const std::string in = picture("png");
  write_file(path("f.1.png"), read_file(in));
  ASSERT_EQ(candela({"stream", path("f.#.png"), path("s.%d.png"), "-q"}).code, 0);
  expect_same_codes(in, path("s.1.png"));
  ASSERT_EQ(candela({"stream", path("f.#.png"), path("e.%d.png"), "--encoding", "png", "-q"}).code, 0);
  expect_same_codes(in, path("e.1.png"));
  EXPECT_EQ(candela_json({"meter", in})["exposure"], 1);
  EXPECT_NE(candela_json({"meter", in, "--scene-light"})["exposure"], 1);
  const Outcome sheet = candela({"contact", in, path("sheet.png"), "--resize", "256x"});
  EXPECT_NE(sheet.out.find("the default of an SDR picture"), std::string::npos) << sheet.out << sheet.err;
}

TEST_F(FinishedPicture, TheSkyOfAViewIsThePicture) {
  Image sky = *image_to_overwrite(128, 64, ImageFormat::kRgba8);
  for (size_t i = 0; i < sky.pixels.size(); ++i)
    sky.pixels.data()[i] = std::byte{i % 4 == 0   ? uint8_t{200}
                                     : i % 4 == 1 ? uint8_t{90}
                                     : i % 4 == 2 ? uint8_t{30}
                                                  : uint8_t{255}};
  const std::string in = picture("png", {}, std::move(sky));
  const auto report = candela_json({"view", in, path("view.png"), "--size", "32x16"});
  EXPECT_EQ(report["curve"], "linear");
  const std::vector<double> codes = codes_of(path("view.png"));
  for (size_t i = 0; i < codes.size(); i += 4) {
    EXPECT_NEAR(codes[i], 200, 1);
    EXPECT_NEAR(codes[i + 1], 90, 1);
    EXPECT_NEAR(codes[i + 2], 30, 1);
  }
  ASSERT_EQ(
      candela({"view", in, path("turn.%d.png"), "--size", "32x16", "--turn", "90", "--frames", "2", "-q"})
          .code,
      0);
  expect_same_codes(path("turn.1.png"), path("view.png"), 0);
}

}  // namespace
}  // namespace candela
