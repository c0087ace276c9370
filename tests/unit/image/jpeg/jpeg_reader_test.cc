// JPEG files as input: SDR pictures, and those whose gain map makes them HDR.

// jpeglib.h needs FILE and size_t to be declared before it.
#include <cstdio>

// clang-format off
#include <jpeglib.h>
// clang-format on

#include <gtest/gtest.h>
#include <lcms2.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/image/image.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/jpeg/jpeg_files.h"

namespace candela {
namespace {

double srgb_light(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }

// HDR light of a base's and a map's code, by the definition.
double hdr(const GainMapMetadata& m, int c, double base, double map) {
  const double g = m.min_log2[c] + (m.max_log2[c] - m.min_log2[c]) * std::pow(map / 255, 1 / m.gamma[c]);
  return (srgb_light(base / 255) + m.offset_sdr[c]) * std::exp2(g) - m.offset_hdr[c];
}

TEST(JpegReader, APlainFileIsCodesOfSrgb) {
  ASSERT_OK_AND_ASSIGN(const Image image,
                       read_jpeg_bytes(jpeg_of(9, 5, flat(100), {100, EncodedTransfer::kUnknown})));
  EXPECT_EQ(image.width, 9u);
  EXPECT_EQ(image.height, 5u);
  EXPECT_EQ(image.format, ImageFormat::kRgba32f);
  EXPECT_EQ(image.signal, "8 bits, sRGB, assumed");
  EXPECT_FALSE(image.display_light);
  EXPECT_FALSE(image.has_alpha);
  EXPECT_FALSE(image.names_primaries);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(image, 8, 4, c), srgb_light(100 / 255.0), 1e-6);
  EXPECT_EQ(component(image, 8, 4, 3), 1);

  ASSERT_OK_AND_ASSIGN(const Image named, read_jpeg_bytes(jpeg_of(9, 5, flat(100))));
  EXPECT_EQ(named.signal, "8 bits, sRGB, from ICC");
  EXPECT_TRUE(named.names_primaries);
  EXPECT_FALSE(named.chromaticities.has_value());
}

TEST(JpegReader, TheChoiceSaysWhatCodesAre) {
  const std::string file = joined(jpeg_of(8, 8, flat(51)), map_of(8, 8, true, flat(255)), stops_of(2));
  ASSERT_OK_AND_ASSIGN(const Image codes, read_jpeg_bytes(file, {.keeps_signal = true}));
  EXPECT_NEAR(component(codes, 3, 3, 0), 0.2, 1e-6);
  EXPECT_FALSE(codes.display_light);
  ASSERT_OK_AND_ASSIGN(const Image linear, read_jpeg_bytes(file, {.transfer = SignalTransfer::kLinear}));
  EXPECT_NEAR(component(linear, 3, 3, 0), 0.2, 1e-6);
  EXPECT_FALSE(linear.display_light);
  EXPECT_TRUE(has_note(linear, "its gain map is not used, because --input-transfer says what the codes are"));
  EXPECT_REFUSED(kInvalidArgument, "only OpenEXR files have parts", read_jpeg_bytes(file, {.part = "1"}));
}

TEST(JpegReader, AGreyFileIsGrey) {
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(map_of(8, 8, true, flat(200))));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(image, 0, 0, c), srgb_light(200 / 255.0), 1e-6);
}

TEST(JpegReader, AGainMapMakesHdrLight) {
  const GainMapMetadata one = {.min_log2 = {-1},
                               .max_log2 = {3},
                               .offset_sdr = {1.0 / 64},
                               .offset_hdr = {1.0 / 64},
                               .headroom_hdr_log2 = 3.2};
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(joined(jpeg_of(16, 8, flat(180)),
                                                                 map_of(16, 8, true, flat(200)), one)));
  EXPECT_TRUE(image.display_light);
  EXPECT_EQ(image.signal, "8 bits, sRGB, from ICC, gain map of 3.2 stops");
  EXPECT_TRUE(has_note(image, "gain map: 1 is reference white"));
  for (int c = 0; c < 3; ++c) {
    EXPECT_NEAR(component(image, 15, 7, c) / hdr(one, 0, 180, 200), 1, 1e-6);
  }
  EXPECT_EQ(component(image, 15, 7, 3), 1);

  const GainMapMetadata three = three_channels();
  const std::string file = joined(jpeg_of(16, 8, flat(180)), map_of(16, 8, false, flat(140)), three);
  ASSERT_OK_AND_ASSIGN(const Image colours, read_jpeg_bytes(file));
  for (int c = 0; c < 3; ++c)
    EXPECT_NEAR(component(colours, 15, 7, c) / hdr(three, c, 180, 140), 1, 1e-6) << c;
}

TEST(JpegReader, CodesStandForThePublishedGains) {
  struct Case {
    GainMapMetadata metadata;
    int code;
    double log2_gain;
  };
  const GainMapMetadata around = {.min_log2 = {-2}, .max_log2 = {2}}, above = {.max_log2 = {3}};
  for (const Case& c : {Case{around, 191, 1}, Case{around, 64, -1}, Case{around, 128, 0}, Case{above, 85, 1},
                        Case{above, 170, 2}}) {
    ASSERT_OK_AND_ASSIGN(
        const Image image,
        read_jpeg_bytes(joined(jpeg_of(8, 8, flat(255)), map_of(8, 8, true, flat(c.code)), c.metadata)));
    const double half_code = (c.metadata.max_log2[0] - c.metadata.min_log2[0]) / 510;
    EXPECT_NEAR(std::log2(component(image, 3, 3, 1)), c.log2_gain, half_code) << c.code;
  }
}

// ISO 21496-1's flag 0x40 is clear if the gains are of light in the HDR picture's primaries.
TEST(JpegReader, OtherPrimariesOfAMapAreNoted) {
  for (const bool one_channel : {true, false}) {
    GainMapMetadata metadata = three_channels();
    metadata.one_channel = one_channel;
    const auto file = [&] {
      return joined(jpeg_of(8, 8, flat(90)), map_of(8, 8, one_channel, flat(77)), metadata);
    };
    constexpr char kNote[] = "its gain map is of light in the HDR picture's primaries";
    ASSERT_OK_AND_ASSIGN(const Image same, read_jpeg_bytes(file()));
    EXPECT_FALSE(has_note(same, kNote));
    metadata.base_primaries = false;
    ASSERT_OK_AND_ASSIGN(const Image other, read_jpeg_bytes(file()));
    EXPECT_EQ(has_note(other, kNote), !one_channel);
  }
}

TEST(JpegReader, LightIsNotNegative) {
  const GainMapMetadata dark = {.min_log2 = {-2}, .max_log2 = {0}, .offset_sdr = {0.1}, .offset_hdr = {0.1}};
  ASSERT_OK_AND_ASSIGN(const Image image,
                       read_jpeg_bytes(joined(jpeg_of(8, 8, flat(0)), map_of(8, 8, true, flat(0)), dark)));
  EXPECT_EQ(component(image, 0, 0, 0), 0);
}

// What JPEG itself loses at quality 95 is in the limits.
TEST(JpegReader, ASmoothHdrPictureComesBack) {
  constexpr uint32_t kWidth = 128, kHeight = 96;
  const auto sdr_code = [](uint32_t x, uint32_t y, int c) {
    return static_cast<int>(60 + x + y / 2 + 5 * c);
  };
  const auto log2_gain = [](uint32_t x, uint32_t y) {
    return 1.6 + 1.5 * std::sin(x * 0.05) * std::cos(y * 0.04);
  };
  const GainMapMetadata metadata = stops_of(3.2);
  std::vector<uint8_t> codes;
  for (uint32_t y = 0; y < kHeight; ++y) {
    for (uint32_t x = 0; x < kWidth; ++x) {
      codes.push_back(static_cast<uint8_t>(std::lround(255 * log2_gain(x, y) / metadata.max_log2[0])));
    }
  }
  ASSERT_OK_AND_ASSIGN(const std::string map, encode_gain_map(codes, kWidth, kHeight, true));
  const std::string base = jpeg_of(kWidth, kHeight, sdr_code, {95});
  ASSERT_OK_AND_ASSIGN(const Image sdr, read_jpeg_bytes(base));
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(joined(base, map, metadata)));
  std::vector<double> of_gain, of_light;  // errors in stops
  for (uint32_t y = 0; y < kHeight; ++y) {
    for (uint32_t x = 0; x < kWidth; ++x) {
      const double light = component(image, x, y, 1);
      of_gain.push_back(std::abs(std::log2(light / component(sdr, x, y, 1)) - log2_gain(x, y)));
      of_light.push_back(
          std::abs(std::log2(light / (srgb_light(sdr_code(x, y, 1) / 255.0) * std::exp2(log2_gain(x, y))))));
    }
  }
  std::ranges::sort(of_gain);
  std::ranges::sort(of_light);
  RecordProperty("gain_max_stops", std::to_string(of_gain.back()));
  RecordProperty("light_max_stops", std::to_string(of_light.back()));
  EXPECT_LE(of_gain[of_gain.size() * 99 / 100], 0.02);
  EXPECT_LE(of_gain.back(), 0.04);
  EXPECT_LE(of_light.back(), 0.05);
}

TEST(JpegReader, ASmallerMapIsSampledBetweenItsPixels) {
  const GainMapMetadata metadata = stops_of(4);
  const auto ramp = [](uint32_t x, uint32_t y, int) { return static_cast<int>(10 + 12 * x + 3 * y); };
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(joined(jpeg_of(32, 32, flat(128)),
                                                                 map_of(16, 16, true, ramp), metadata)));
  const double white = srgb_light(128 / 255.0);
  for (uint32_t y = 0; y < 32; ++y) {
    for (uint32_t x = 0; x < 32; ++x) {
      const double u = std::clamp((x + 0.5) / 2 - 0.5, 0.0, 15.0),
                   v = std::clamp((y + 0.5) / 2 - 0.5, 0.0, 15.0);
      const double expected = 4 * (10 + 12 * u + 3 * v) / 255;
      EXPECT_NEAR(std::log2(component(image, x, y, 2) / white), expected, 4 * 1.0 / 255) << x << ' ' << y;
    }
  }
  const GainMapMetadata three = three_channels();
  ASSERT_OK_AND_ASSIGN(const Image colours, read_jpeg_bytes(joined(jpeg_of(17, 11, flat(128)),
                                                                   map_of(5, 7, false, flat(140)), three)));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(colours, 16, 10, c) / hdr(three, c, 128, 140), 1, 1e-6);
}

TEST(JpegReader, EitherPlaceAndEitherMetadataWillDo) {
  for (const bool one_channel : {true, false}) {
    GainMapMetadata metadata = three_channels();
    metadata.one_channel = one_channel;
    metadata.headroom_base_log2 = 0.25;
    const std::string file =
        joined(jpeg_of(16, 16, flat(90)), map_of(16, 16, one_channel, flat(77)), metadata);
    ASSERT_OK_AND_ASSIGN(const Image all, read_jpeg_bytes(file));
    EXPECT_EQ(all.signal, "8 bits, sRGB, from ICC, gain map of 3 stops");
    const std::string without_mpf = renamed(file, std::string("MPF\0", 4), std::string("MPX\0", 4));
    const std::string without_directory = renamed(file, "<Container:Item", "<Kontainer:Item");
    const std::string without_iso = renamed(file, kIsoGainMap, "urn:iso:std:iso:ts:99999:-1");
    const std::string without_xmp = renamed(file, "hdrgm:Version", "hdrgx:Version");
    for (const std::string& other : {without_mpf, without_directory, without_iso, without_xmp}) {
      ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(other));
      EXPECT_EQ(image.signal, all.signal);
      for (int c = 0; c < 4; ++c) {
        EXPECT_NEAR(component(image, 7, 7, c), component(all, 7, 7, c), 1e-6 * component(all, 7, 7, c));
      }
    }
    // A later version than ours is left to the XMP.
    ASSERT_OK_AND_ASSIGN(const Image later, read_jpeg_bytes(with_iso(file, std::string("\0\1", 2))));
    EXPECT_NEAR(component(later, 7, 7, 0), component(all, 7, 7, 0), 1e-6);
    EXPECT_REFUSED(kInvalidArgument, "the gain map needs version 1 of ISO 21496-1; Candela reads version 0",
                   read_jpeg_bytes(with_iso(without_xmp, std::string("\0\1", 2))));
    // Without any word about a map, another picture in the file is none.
    ASSERT_OK_AND_ASSIGN(const Image plain,
                         read_jpeg_bytes(renamed(without_xmp, kIsoGainMap, "urn:iso:std:iso:ts:99999:-1")));
    EXPECT_FALSE(plain.display_light);
    EXPECT_TRUE(plain.notes.empty());
  }
}

TEST(JpegReader, OneDenominatorMayServeAllFractions) {
  const std::string file = joined(jpeg_of(8, 8, flat(90)), map_of(8, 8, true, flat(255)), stops_of(1));
  std::string iso = std::string("\0\0\0\0\x48", 5);
  for (const int v : {10, 0, 30, 0, 30, 10, 0, 0}) iso += std::string("\0\0\0", 3) + static_cast<char>(v);
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(with_iso(file, iso)));
  EXPECT_NEAR(component(image, 0, 0, 0), srgb_light(90 / 255.0) * 8, 1e-5);
  EXPECT_EQ(image.signal, "8 bits, sRGB, from ICC, gain map of 3 stops");
}

// A profile of P3 primaries and the sRGB curve.
std::string p3_profile(const char* description, double version = 4.4) {
  const cmsCIExyY white = {0.3127, 0.3290, 1};
  const cmsCIExyYTRIPLE primaries = {{0.68, 0.32, 1}, {0.265, 0.69, 1}, {0.15, 0.06, 1}};
  cmsToneCurve* curve = cmsBuildGamma(nullptr, 2.2);
  cmsToneCurve* curves[] = {curve, curve, curve};
  cmsHPROFILE profile = cmsCreateRGBProfile(&white, &primaries, curves);
  cmsFreeToneCurve(curve);
  cmsSetProfileVersion(profile, version);
  cmsMLU* words = cmsMLUalloc(nullptr, 1);
  cmsMLUsetASCII(words, "en", "US", description);
  cmsWriteTag(profile, cmsSigProfileDescriptionTag, words);
  cmsMLUfree(words);
  cmsUInt32Number size = 0;
  cmsSaveProfileToMem(profile, nullptr, &size);
  std::string bytes(size, '\0');
  cmsSaveProfileToMem(profile, bytes.data(), &size);
  cmsCloseProfile(profile);
  return bytes;
}

TEST(JpegReader, ItsProfileNamesThePrimaries) {
  const std::string base = jpeg_of(8, 8, flat(90), {100, EncodedTransfer::kUnknown});
  const auto part = [](int number, int count, const std::string& bytes) {
    return jpeg_segment(0xe2, std::string("ICC_PROFILE\0", 12) + static_cast<char>(number) +
                                  static_cast<char>(count) + bytes);
  };
  const std::string profile = p3_profile("Display P3");
  // In two parts, the second one first.
  const std::string file =
      joined(with(base, part(2, 2, profile.substr(100)) + part(1, 2, profile.substr(0, 100))),
             map_of(8, 8, true, flat(255)), stops_of(1));
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(file));
  EXPECT_TRUE(image.names_primaries);
  ASSERT_TRUE(image.chromaticities.has_value());
  EXPECT_EQ((*image.chromaticities)[0], 0.68f);
  EXPECT_EQ(image.signal, "8 bits, sRGB, from ICC, gain map of 1 stops");
  EXPECT_NEAR(component(image, 0, 0, 1), 2 * srgb_light(90 / 255.0), 1e-5);
  ASSERT_OK_AND_ASSIGN(const Image own, read_jpeg_bytes(file, {.own_values = true}));
  EXPECT_FALSE(own.chromaticities.has_value());

  ASSERT_OK_AND_ASSIGN(const Image older,
                       read_jpeg_bytes(with(base, part(1, 1, p3_profile("Display P3", 2.1)))));
  EXPECT_EQ(older.chromaticities, image.chromaticities);

  for (const auto& [bytes, note] : {std::pair(part(1, 1, p3_profile("A printer")),
                                              "the ICC profile \"A printer\" is none that Candela knows"),
                                    {part(1, 2, profile), "its ICC profile cannot be read"},
                                    {part(1, 1, "?"), "its ICC profile cannot be read"}}) {
    ASSERT_OK_AND_ASSIGN(const Image other, read_jpeg_bytes(with(base, bytes)));
    EXPECT_FALSE(other.names_primaries);
    EXPECT_TRUE(has_note(other, note)) << note;
  }
}

// Exif's picture of the eight orientations: 24 x 16 pixels, where each block of 8 x 8 has its code.
TEST(JpegReader, PicturesAreUpright) {
  const auto block = [](uint32_t x, uint32_t y, int) {
    return static_cast<int>(20 + 30 * (x / 8 + 3 * (y / 8)));
  };
  const std::array<std::vector<int>, 9> expected = {{{},
                                                     {20, 50, 80, 110, 140, 170},
                                                     {80, 50, 20, 170, 140, 110},
                                                     {170, 140, 110, 80, 50, 20},
                                                     {110, 140, 170, 20, 50, 80},
                                                     {20, 110, 50, 140, 80, 170},
                                                     {110, 20, 140, 50, 170, 80},
                                                     {170, 80, 140, 50, 110, 20},
                                                     {80, 170, 50, 140, 20, 110}}};
  for (int turn = 1; turn <= 8; ++turn) {
    for (const bool big : {true, false}) {
      const char code = static_cast<char>(turn);
      const std::string exif = big ? std::string("Exif\0\0MM\0\x2a\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0", 25) +
                                         code + std::string(6, '\0')
                                   : std::string("Exif\0\0II\x2a\0\x08\0\0\0\1\0\x12\x01\3\0\1\0\0\0", 24) +
                                         code + std::string(7, '\0');
      const std::string base = with(jpeg_of(24, 16, block), jpeg_segment(0xe1, exif));
      ASSERT_OK_AND_ASSIGN(const Image plain, read_jpeg_bytes(base));
      // With a map whose gain is the square root of the code's light, turned likewise.
      ASSERT_OK_AND_ASSIGN(const Image image,
                           read_jpeg_bytes(joined(base, map_of(24, 16, true, block), stops_of(2))));
      ASSERT_EQ(plain.width, turn < 5 ? 24u : 16u);
      ASSERT_EQ(plain.height, turn < 5 ? 16u : 24u);
      std::vector<int> seen;
      for (uint32_t y = 4; y < plain.height; y += 8) {
        for (uint32_t x = 4; x < plain.width; x += 8) {
          const int should = expected[turn][seen.size()];
          EXPECT_NEAR(component(plain, x, y, 0), srgb_light(should / 255.0), 1e-6) << turn;
          EXPECT_NEAR(component(image, x, y, 0), srgb_light(should / 255.0) * std::exp2(2 * should / 255.0),
                      1e-5);
          seen.push_back(should);
        }
      }
    }
  }
  ASSERT_OK_AND_ASSIGN(
      const Image image,
      read_jpeg_bytes(with(jpeg_of(24, 16, block),
                           jpeg_segment(0xe1, std::string("Exif\0\0MM\0\x2a\xff\xff\xff\xff", 14)))));
  EXPECT_EQ(image.width, 24u);
}

TEST(JpegReader, PixelsHaveAnAspect) {
  std::vector<std::byte> rows(4 * 4 * 4);
  std::string file;
  ASSERT_OK(
      encode_jpeg({.width = 4, .height = 4, .rows = rows.data(), .row_stride_bytes = 16, .aspect_width = 2},
                  {}, [&file](const void* bytes, size_t count) {
                    file.append(static_cast<const char*>(bytes), count);
                    return true;
                  }));
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(file));
  EXPECT_EQ(image.pixel_aspect, 2);
}

}  // namespace
}  // namespace candela
