// JPEG files: read, damaged, and with gain maps.
// jpeglib.h needs FILE and size_t to be declared before it.
// clang-format off
#include <cstdio>
#include <jpeglib.h>
// clang-format on

#include <gtest/gtest.h>
#include <lcms2.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <map>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/image/color.h"
#include "client/image/image.h"
#include "server/encode/gain_map.h"
#include "server/encode/picture.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

using CodeAt = std::function<int(uint32_t x, uint32_t y, int channel)>;

// The picture of these codes, of the best quality.
std::string jpeg_of(uint32_t width, uint32_t height, const CodeAt& code, const JpegOptions& options = {100}) {
  std::vector<std::byte> rows(size_t{4} * width * height, std::byte{255});
  for (size_t i = 0; i < rows.size(); ++i) {
    const size_t pixel = i / 4;
    if (i % 4 == 3) continue;
    rows[i] = static_cast<std::byte>(code(static_cast<uint32_t>(pixel % width),
                                          static_cast<uint32_t>(pixel / width), static_cast<int>(i % 4)));
  }
  std::string file;
  EXPECT_OK(encode_jpeg(
      {.width = width, .height = height, .rows = rows.data(), .row_stride_bytes = size_t{4} * width}, options,
      [&file](const void* bytes, size_t count) {
        file.append(static_cast<const char*>(bytes), count);
        return true;
      }));
  return file;
}

// The map of these codes.
std::string map_of(uint32_t width, uint32_t height, bool one_channel, const CodeAt& code) {
  std::vector<uint8_t> codes;
  for (uint32_t y = 0; y < height; ++y) {
    for (uint32_t x = 0; x < width; ++x) {
      for (int c = 0; c < (one_channel ? 1 : 3); ++c) codes.push_back(static_cast<uint8_t>(code(x, y, c)));
    }
  }
  const absl::StatusOr<std::string> file = encode_gain_map(codes, width, height, one_channel, 100);
  EXPECT_OK(file.status());
  return file.value_or("");
}

std::string joined(const std::string& base, const std::string& map, const GainMapMetadata& metadata) {
  const absl::StatusOr<std::string> file = join_gain_map(base, map, metadata);
  EXPECT_OK(file.status());
  return file.value_or("");
}

// Gains of 0 .. `stops`, of one channel.
GainMapMetadata stops_of(double stops) {
  return {.max_log2 = {stops, stops, stops}, .headroom_hdr_log2 = stops};
}

// A segment of a JPEG file, with its marker and length.
std::string jpeg_segment(int marker, const std::string& body) {
  const size_t length = body.size() + 2;
  return std::string{'\xff', static_cast<char>(marker), static_cast<char>(length >> 8),
                     static_cast<char>(length)} +
         body;
}

absl::StatusOr<Image> read_jpeg_bytes(const std::string& bytes, const PictureChoice& choice = {},
                                      const ImageLimits& limits = {}) {
  return read_image_bytes("file", bytes, limits, choice);
}

CodeAt flat(int code) {
  return [code](uint32_t, uint32_t, int) { return code; };
}

bool has_note(const Image& image, const std::string& words) {
  return std::ranges::any_of(image.notes,
                             [&](const std::string& note) { return note.find(words) != note.npos; });
}

int noise(uint32_t x, uint32_t y, int c) {
  return static_cast<int>((x * 97 + y * 57 + x * y * 31 + 80 * c) % 256);
}

// Puts segments behind the start of a file.
std::string with(const std::string& file, const std::string& segments) {
  return file.substr(0, 2) + segments + file.substr(2);
}

// The file with every `from` replaced by `to`, which is as long; or only the one number `which`, from 0.
std::string renamed(std::string file, const std::string& from, const std::string& to, int which = -1) {
  EXPECT_EQ(from.size(), to.size());
  int count = 0;
  for (size_t at = 0; (at = file.find(from, at)) != file.npos; at += from.size()) {
    if (which < 0 || which == count) file.replace(at, to.size(), to);
    ++count;
  }
  EXPECT_GT(count, std::max(which, 0)) << from;
  return file;
}

const std::string kIsoGainMap = "urn:iso:std:iso:ts:21496:-1";

// The file with the map's ISO metadata replaced, from its first byte.
std::string with_iso(std::string file, const std::string& bytes) {
  const size_t at = file.rfind(kIsoGainMap) + kIsoGainMap.size() + 1;
  return file.replace(at, bytes.size(), bytes);
}

constexpr char kItemSpace[] = "http://ns.google.com/photos/1.0/container/item/";

std::string without_adobe(const std::string& file) {
  return renamed(file, "http://ns.adobe.com/hdr-gain-map/1.0/", "http://ns.adobe.com/hdr-gain-none/1.0");
}

// Why the gain map of this file is not used, by its note. Its picture is the SDR one.
std::string why_unused(const std::string& file, const ImageLimits& limits = {}) {
  const absl::StatusOr<Image> image = read_jpeg_bytes(file, {}, limits);
  EXPECT_OK(image);
  if (!image.ok()) return "";
  EXPECT_EQ(image->missing_pixels, 0u);
  const std::string begin = "its gain map is not used: ", end = "; the picture without it is shown";
  for (const std::string& note : image->notes) {
    if (!absl::StartsWith(note, begin) || !absl::EndsWith(note, end)) continue;
    EXPECT_EQ(image->light, PictureLight::kSdr);
    return note.substr(begin.size(), note.size() - begin.size() - end.size());
  }
  return image->light == PictureLight::kHdr ? "it is used" : "no note";
}

GainMapMetadata three_channels() {
  return {.min_log2 = {-1, -0.5, 0},
          .max_log2 = {2, 3, 4},
          .gamma = {1, 0.5, 2},
          .offset_sdr = {1.0 / 64, 1.0 / 32, 1.0 / 16},
          .offset_hdr = {1.0 / 32, 1.0 / 64, 1.0 / 128},
          .headroom_hdr_log2 = 3.2,
          .one_channel = false};
}

// JPEG files as input: SDR pictures, and those whose gain map makes them HDR.

double light_of_srgb(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }

// HDR light of a base's and a map's code, by the definition.
double hdr(const GainMapMetadata& m, int c, double base, double map) {
  const double g = m.min_log2[c] + (m.max_log2[c] - m.min_log2[c]) * std::pow(map / 255, 1 / m.gamma[c]);
  return (light_of_srgb(base / 255) + m.offset_sdr[c]) * std::exp2(g) - m.offset_hdr[c];
}

TEST(JpegReader, APlainFileIsCodesOfSrgb) {
  ASSERT_OK_AND_ASSIGN(const Image image,
                       read_jpeg_bytes(jpeg_of(9, 5, flat(100), {100, EncodedTransfer::kUnknown})));
  EXPECT_EQ(image.width, 9u);
  EXPECT_EQ(image.height, 5u);
  EXPECT_EQ(image.format, ImageFormat::kRgba32f);
  EXPECT_EQ(image.signal, "8 bits, sRGB, assumed");
  EXPECT_NE(image.light, PictureLight::kHdr);
  EXPECT_FALSE(image.has_alpha);
  EXPECT_FALSE(image.names_primaries);
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(image, 8, 4, c), light_of_srgb(100 / 255.0), 1e-6);
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
  EXPECT_NE(codes.light, PictureLight::kHdr);
  ASSERT_OK_AND_ASSIGN(const Image linear, read_jpeg_bytes(file, {.transfer = SignalTransfer::kLinear}));
  EXPECT_NEAR(component(linear, 3, 3, 0), 0.2, 1e-6);
  EXPECT_NE(linear.light, PictureLight::kHdr);
  EXPECT_TRUE(has_note(linear, "its gain map is not used, because --input-transfer says what the codes are"));
  EXPECT_REFUSED(kInvalidArgument, "only OpenEXR files have parts", read_jpeg_bytes(file, {.part = "1"}));
}

TEST(JpegReader, AGreyFileIsGrey) {
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(map_of(8, 8, true, flat(200))));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(image, 0, 0, c), light_of_srgb(200 / 255.0), 1e-6);
}

TEST(JpegReader, AGainMapMakesHdrLight) {
  const GainMapMetadata one = {.min_log2 = {-1},
                               .max_log2 = {3},
                               .offset_sdr = {1.0 / 64},
                               .offset_hdr = {1.0 / 64},
                               .headroom_hdr_log2 = 3.2};
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(joined(jpeg_of(16, 8, flat(180)),
                                                                 map_of(16, 8, true, flat(200)), one)));
  EXPECT_EQ(image.light, PictureLight::kHdr);
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
      of_light.push_back(std::abs(
          std::log2(light / (light_of_srgb(sdr_code(x, y, 1) / 255.0) * std::exp2(log2_gain(x, y))))));
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
  const double white = light_of_srgb(128 / 255.0);
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
    const std::string without_directory =
        renamed(file, kItemSpace, "http://ns.google.com/photos/1.0/container/none/");
    const std::string without_iso = renamed(file, kIsoGainMap, "urn:iso:std:iso:ts:99999:-1");
    const std::string without_xmp = without_adobe(file);
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
    EXPECT_EQ(why_unused(with_iso(without_xmp, std::string("\0\1", 2))),
              "it needs version 1 of ISO 21496-1; Candela reads version 0");
    // Without any word about a map, another picture in the file is none.
    ASSERT_OK_AND_ASSIGN(const Image plain,
                         read_jpeg_bytes(renamed(without_xmp, kIsoGainMap, "urn:iso:std:iso:ts:99999:-1")));
    EXPECT_NE(plain.light, PictureLight::kHdr);
    EXPECT_TRUE(plain.notes.empty());
  }
}

TEST(JpegReader, OneDenominatorMayServeAllFractions) {
  const std::string file = joined(jpeg_of(8, 8, flat(90)), map_of(8, 8, true, flat(255)), stops_of(1));
  std::string iso = std::string("\0\0\0\0\x48", 5);
  for (const int v : {10, 0, 30, 0, 30, 10, 0, 0}) iso += std::string("\0\0\0", 3) + static_cast<char>(v);
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(with_iso(file, iso)));
  EXPECT_NEAR(component(image, 0, 0, 0), light_of_srgb(90 / 255.0) * 8, 1e-5);
  EXPECT_EQ(image.signal, "8 bits, sRGB, from ICC, gain map of 3 stops");
}

// A profile of P3 primaries and the sRGB curve.
std::string p3_profile(double version = 4.4) {
  const cmsCIExyY white = {0.3127, 0.3290, 1};
  const cmsCIExyYTRIPLE primaries = {{0.68, 0.32, 1}, {0.265, 0.69, 1}, {0.15, 0.06, 1}};
  const cmsFloat64Number srgb[] = {2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045};
  cmsToneCurve* curve = cmsBuildParametricToneCurve(nullptr, 4, srgb);
  cmsToneCurve* curves[] = {curve, curve, curve};
  cmsHPROFILE profile = cmsCreateRGBProfile(&white, &primaries, curves);
  cmsFreeToneCurve(curve);
  cmsSetProfileVersion(profile, version);
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
  const std::string profile = p3_profile();
  // In two parts, the second one first.
  const std::string file =
      joined(with(base, part(2, 2, profile.substr(100)) + part(1, 2, profile.substr(0, 100))),
             map_of(8, 8, true, flat(255)), stops_of(1));
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(file));
  EXPECT_TRUE(image.names_primaries);
  ASSERT_TRUE(image.chromaticities.has_value());
  EXPECT_EQ((*image.chromaticities)[0], 0.68f);
  EXPECT_EQ(image.signal, "8 bits, sRGB, from ICC, gain map of 1 stops");
  EXPECT_NEAR(component(image, 0, 0, 1), 2 * light_of_srgb(90 / 255.0), 1e-5);
  ASSERT_OK_AND_ASSIGN(const Image own, read_jpeg_bytes(file, {.own_values = true}));
  EXPECT_FALSE(own.chromaticities.has_value());

  ASSERT_OK_AND_ASSIGN(const Image older, read_jpeg_bytes(with(base, part(1, 1, p3_profile(2.1)))));
  EXPECT_EQ(older.chromaticities, image.chromaticities);

  for (const std::string& bytes :
       {part(1, 2, profile), part(1, 1, "?"), part(1, 1, profile.substr(0, 300))}) {
    ASSERT_OK_AND_ASSIGN(const Image other, read_jpeg_bytes(with(base, bytes)));
    EXPECT_FALSE(other.names_primaries);
    EXPECT_TRUE(has_note(other, "its ICC profile cannot be used: it"));
  }
}

// DCF: a camera's Adobe RGB has no colour space of Exif, and the rule R03.
TEST(JpegReader, ExifNamesAdobeRgbAlsoInAPng) {
  const std::string base = jpeg_of(8, 8, flat(90), {100, EncodedTransfer::kUnknown});
  const auto exif_of = [](const std::string& space, const std::string& rule) {
    // Directories of one, two and one tags at 8, 26 and 56.
    return std::string("MM\0\x2a\0\0\0\x08\0\1\x87\x69\0\4\0\0\0\1\0\0\0\x1a\0\0\0\0", 26) +
           std::string("\0\2\xa0\1\0\3\0\0\0\1", 10) + space + std::string(2, '\0') +
           std::string("\xa0\5\0\4\0\0\0\1\0\0\0\x38\0\0\0\0", 16) + std::string("\0\1\0\1\0\2\0\0\0\4", 10) +
           rule + std::string(5, '\0');
  };
  const auto in_jpeg = [&](const std::string& exif) {
    return with(base, jpeg_segment(0xe1, std::string("Exif\0\0", 6) + exif));
  };
  const std::string adobe = exif_of("\xff\xff", "R03");
  for (const std::string& file : {in_jpeg(adobe), png_of(1, 8, 0, "\x5a", chunk("eXIf", adobe))}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(file));
    EXPECT_EQ(image.signal, "8 bits, gamma 2.2, from Exif");
    EXPECT_EQ(*image.chromaticities, kAdobeRgb.xy);
    EXPECT_NEAR(component(image, 0, 0, 0), std::pow(90 / 255.0, 563 / 256.0), 1e-6);
  }
  for (const std::string& other : {exif_of("\xff\xff", "R98"), exif_of(std::string("\0\1", 2), "R03")}) {
    EXPECT_EQ(read_jpeg_bytes(in_jpeg(other))->signal, "8 bits, sRGB, assumed");
  }
  for (size_t size = 0; size < adobe.size() - 8; ++size) {
    EXPECT_EQ(read_jpeg_bytes(in_jpeg(adobe.substr(0, size)))->signal, "8 bits, sRGB, assumed") << size;
  }
}

TEST(JpegReader, AMapIsOfTheLightThatTheProfileSays) {
  const std::string base = jpeg_of(8, 8, flat(90), {100, EncodedTransfer::kGamma22});
  ASSERT_OK_AND_ASSIGN(const Image image,
                       read_jpeg_bytes(joined(base, map_of(8, 8, true, flat(255)), stops_of(1))));
  EXPECT_NEAR(component(image, 3, 3, 1), 2 * std::pow(90 / 255.0, 2.2), 1e-5);
  EXPECT_EQ(image.light, PictureLight::kHdr);
}

// A profile of PQ makes HDR light by itself.
TEST(JpegReader, AnHdrPictureHasNoUseForAMap) {
  cmsHPROFILE profile = cmsCreate_sRGBProfile();
  EXPECT_TRUE(
      cmsWriteRawTag(profile, static_cast<cmsTagSignature>(0x63696370), "cicp\0\0\0\0\x09\x10\0\1", 12));
  cmsUInt32Number size = 0;
  cmsSaveProfileToMem(profile, nullptr, &size);
  std::string bytes(size, '\0');
  cmsSaveProfileToMem(profile, bytes.data(), &size);
  cmsCloseProfile(profile);
  const std::string pq = with(jpeg_of(8, 8, flat(90), {100, EncodedTransfer::kUnknown}),
                              jpeg_segment(0xe2, std::string("ICC_PROFILE\0\1\1", 14) + bytes));
  ASSERT_OK_AND_ASSIGN(const Image plain, read_jpeg_bytes(pq));
  const std::string file = joined(pq, map_of(8, 8, true, flat(255)), stops_of(3));
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(file));
  EXPECT_EQ(image.light, PictureLight::kHdr);
  EXPECT_EQ(image.peak, plain.peak);
  EXPECT_TRUE(same_pixels(image, plain));
  EXPECT_TRUE(has_note(image, "its gain map is not used: its profile says PQ or HLG"));
  // As the base of a map that makes the SDR picture, it is as bright as the map says.
  ASSERT_OK_AND_ASSIGN(const Image base,
                       read_jpeg_bytes(renamed(renamed(file, kIsoGainMap, "urn:iso:std:iso:ts:99999:-1"),
                                               "\"False\"", "\"True\" ")));
  EXPECT_TRUE(same_pixels(base, plain));
  EXPECT_NEAR(base.peak, 8, 1e-10);
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
          EXPECT_NEAR(component(plain, x, y, 0), light_of_srgb(should / 255.0), 1e-6) << turn;
          EXPECT_NEAR(component(image, x, y, 0),
                      light_of_srgb(should / 255.0) * std::exp2(2 * should / 255.0), 1e-5);
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

// Damaged, hostile and unsupported JPEG files as input.

TEST(JpegReader, AMapWhoseWordsMeanNothingIsNotUsed) {
  const std::string file = joined(jpeg_of(8, 8, flat(90)), map_of(8, 8, true, flat(255)), stops_of(1));
  const std::string by_iso = without_adobe(file);
  EXPECT_EQ(why_unused(file), "it is used");
  EXPECT_EQ(why_unused(by_iso), "it is used");
  EXPECT_EQ(why_unused(with_iso(by_iso, std::string("\0\0\0\0\x40\0\0\0\0\0\0\0\0", 13))),
            "the base's headroom of the gain map is nan; it must be within 0 .. 64");
  EXPECT_EQ(why_unused(with_iso(by_iso, std::string("\0\0\0\0\xc0", 5))),
            "its ISO 21496-1 metadata ends too early");
  EXPECT_EQ(why_unused(with_iso(file, std::string("\0\0\0\0\xc0", 5))), "it is used");  // by Adobe's words
  const std::string by_xmp = renamed(file, kIsoGainMap, "urn:iso:std:iso:ts:99999:-1");
  EXPECT_EQ(why_unused(renamed(by_xmp, "hdrgm:GainMapMax=\"1\"", "hdrgm:GainMapMax=\"x\"")),
            "its hdrgm:GainMapMax is not 1 or 3 numbers");
  EXPECT_EQ(why_unused(renamed(by_xmp, "hdrgm:Gamma=\"1\"", "hdrgm:Gamma=\"0\"")),
            "the gamma of the gain map is 0; it must be within 0.01 .. 100");
  EXPECT_EQ(why_unused(renamed(by_xmp, "hdrgm:HDRCapacityMax", "hdrgm:hdrCapacityMax")),
            "it has no hdrgm:HDRCapacityMax");
  EXPECT_EQ(why_unused(renamed(by_xmp, "hdrgm:GainMapMax", "hdrgm:gainMapMax")),
            "it has no hdrgm:GainMapMax");
}

// ISO 21496-1: with all of a display's headroom an HDR base is shown as it is.
TEST(JpegReader, AnHdrBaseIsShownAsItIs) {
  const std::string file = joined(jpeg_of(8, 8, flat(90)), map_of(8, 8, true, flat(255)), stops_of(1));
  const std::string by_iso = without_adobe(file);
  const std::string by_xmp = renamed(file, kIsoGainMap, "urn:iso:std:iso:ts:99999:-1");
  const std::string falls("\0\0\0\0\x40\0\0\0\2\0\0\0\1", 13);
  for (const std::string& one : {with_iso(by_iso, falls), with_iso(by_iso, std::string("\0\0\0\0\x44", 5)),
                                 renamed(by_xmp, "\"False\"", "\"True\" ")}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(one));
    EXPECT_NEAR(component(image, 3, 3, 1), light_of_srgb(90 / 255.0), 1e-6);
    EXPECT_EQ(image.light, PictureLight::kSdr);
    EXPECT_TRUE(image.has_gain_map);
    EXPECT_TRUE(
        has_note(image, "its own picture is the HDR one and is shown: its gain map makes the SDR one"));
  }
}

TEST(JpegReader, TheChoiceMayBeTheBase) {
  const std::string base = jpeg_of(8, 8, flat(90));
  const std::string file = joined(base, map_of(8, 8, true, flat(255)), stops_of(1));
  ASSERT_OK_AND_ASSIGN(const Image hdr, read_jpeg_bytes(file));
  EXPECT_TRUE(hdr.has_gain_map);
  EXPECT_NEAR(hdr.peak, 2, 1e-12);
  for (const bool maps : {true, false}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(maps ? file : base, {.base_of_gain_map = true}));
    EXPECT_EQ(image.has_gain_map, maps);
    EXPECT_EQ(image.light, PictureLight::kSdr);
    EXPECT_TRUE(image.notes.empty());
    EXPECT_NEAR(component(image, 3, 3, 1), light_of_srgb(90 / 255.0), 1e-6);
  }
}

TEST(JpegReader, ALostMapLeavesTheSdrPicture) {
  const std::string base = jpeg_of(16, 16, flat(90));
  const std::string file = joined(base, map_of(16, 16, true, noise), stops_of(1));
  const size_t map_at = file.find("\xff\xd9\xff\xd8") + 2;
  EXPECT_EQ(why_unused(file.substr(0, map_at)), "the file speaks of one, and holds none");
  EXPECT_EQ(why_unused(file.substr(0, map_at + 300)), "the file speaks of one, and holds none");
  EXPECT_EQ(why_unused(file.substr(0, file.size() - 40)), "damaged gain map: Premature end of JPEG file");
  EXPECT_EQ(why_unused(file.substr(0, file.size() - 2)), "it is used");  // only its end mark is missing
  std::string damaged = file;
  damaged.replace(map_at + 1, 1, "\xd9");
  EXPECT_EQ(why_unused(damaged), "the file speaks of one, and holds none");
}

// An editor changed the file before the map, or what stands between it and the picture.
TEST(JpegReader, AMapThatMovedIsFound) {
  const std::string file = joined(jpeg_of(16, 16, flat(90)), map_of(16, 16, true, flat(255)), stops_of(1));
  const size_t map_at = file.find("\xff\xd9\xff\xd8") + 2;
  const std::string preview = jpeg_of(8, 8, flat(3));
  std::string moved = file;
  moved.insert(map_at, "other bytes" + preview + "\xff\xd8\xff");
  const std::string nowhere = renamed(renamed(file, std::string("MPF\0", 4), std::string("MPX\0", 4)),
                                      kItemSpace, "http://ns.google.com/photos/1.0/container/none/");
  std::string no_end = file;
  no_end.erase(map_at - 2, 2);
  for (const std::string& one : {moved, nowhere, no_end}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(one));
    EXPECT_EQ(image.light, PictureLight::kHdr);
    EXPECT_NEAR(component(image, 3, 3, 1), 2 * light_of_srgb(90 / 255.0), 1e-6);
  }
}

// Files of parts: a picture and a map, each with one segment more.
std::string xmp_segment(const std::string& inside) {
  return jpeg_segment(0xe1, std::string("http://ns.adobe.com/xap/1.0/\0", 29) +
                                "<x:xmpmeta xmlns:x='adobe:ns:meta/'><r:RDF "
                                "xmlns:r='http://www.w3.org/1999/02/22-rdf-syntax-ns#'>" +
                                inside + "</r:RDF></x:xmpmeta>");
}

TEST(JpegReader, XmpMayBeWrittenInManyWays) {
  const std::string map = map_of(8, 8, true, flat(255));
  const std::string space = " xmlns:h='http://ns.adobe.com/hdr-gain-map/1.0/'";
  const auto element = [](const std::string& name, const std::string& value) {
    return "<h:" + name + ">" + value + "</h:" + name + ">";
  };
  const std::string most = element("HDRCapacityMax", " 3\n") + element("OffsetSDR", "0") +
                           element("BaseRenditionIsHDR", "False") + element("OffsetHDR", "&#48;");
  const std::string seq = "<r:Seq><r:li>3</r:li><r:li>3</r:li><!-- --><r:li>3</r:li></r:Seq>";
  for (const std::string& words :
       {"<r:Description" + space + ">" + most + element("GainMapMax", "3") + "</r:Description>",
        "<r:Description" + space + ">" + element("GainMapMax", seq) + most + "</r:Description>",
        "<r:Description" + space + ">" + most + "</r:Description><r:Description" + space +
            " h:GainMapMax='3'/>",
        "<r:Description xmlns='http://ns.adobe.com/hdr-gain-map/1.0/'" + space + "><GainMapMax>" +
            "<r:Description><r:value>3</r:value></r:Description></GainMapMax>" + most + "</r:Description>"}) {
    const std::string words_of_map = with(map, xmp_segment(words));
    const auto light = [&](const std::string& directory) {
      const std::string base = with(jpeg_of(8, 8, flat(90)), xmp_segment(directory));
      const absl::StatusOr<Image> image = read_jpeg_bytes(base + "padding" + words_of_map);
      EXPECT_OK(image);
      return image.ok() ? component(*image, 3, 3, 1) : 0;
    };
    EXPECT_NEAR(light(""), 8 * light_of_srgb(90 / 255.0), 1e-5) << words;
  }
}

// Adobe's words in the file's own picture; only the directory leads to the map, in attributes or elements.
TEST(JpegReader, AMapWithoutWordsHasThoseOfThePicture) {
  const std::string own =
      " xmlns:h='http://ns.adobe.com/hdr-gain-map/1.0/' h:Version='1.0' h:GainMapMax='3' "
      "h:HDRCapacityMax='3' "
      "h:OffsetSDR='0' h:OffsetHDR='0' xmlns:c='http://ns.google.com/photos/1.0/container/' xmlns:i='" +
      std::string(kItemSpace) + "'";
  const std::string attributes =
      "<r:li r:parseType='Resource'><c:Item i:Semantic='Primary' i:Mime='image/jpeg' i:Padding='7'/></r:li>"
      "<r:li r:parseType='Resource'><c:Item i:Semantic='GainMap' i:Mime='image/jpeg'/></r:li>";
  const std::string elements =
      "<r:li><c:Item r:parseType='Resource'><i:Padding>7</i:Padding><i:Semantic>Primary</i:Semantic></c:Item>"
      "</r:li><r:li><r:Description><c:Item r:parseType='Resource'><i:Mime>image/jpeg</i:Mime>"
      "<i:Semantic>GainMap</i:Semantic></c:Item></r:Description></r:li>";
  const std::string map = map_of(8, 8, true, flat(255));
  for (const std::string& items : {attributes, elements}) {
    const std::string base =
        with(jpeg_of(8, 8, flat(90)), xmp_segment("<r:Description" + own + "><c:Directory><r:Seq>" + items +
                                                  "</r:Seq></c:Directory></r:Description>"));
    ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(base + "padding" + map));
    EXPECT_NEAR(component(image, 3, 3, 1), 8 * light_of_srgb(90 / 255.0), 1e-5) << items;
    EXPECT_EQ(why_unused(base + map), "the file speaks of one, and holds none");  // not where it says
  }
}

// Apple's maps, by "Applying Apple HDR effect to your photos".

std::string big(uint32_t v, int bytes) {
  std::string text;
  for (int i = bytes - 1; i >= 0; --i) text += static_cast<char>(v >> 8 * i);
  return text;
}

// An iPhone's Exif whose maker note has these thousandths as its numbers 33 and 48.
std::string apple_exif(int of_33, int of_48, int type = 10) {
  std::string note = std::string("Apple iOS\0\0\1MM", 14) + big(2, 2);
  for (const uint32_t tag : {33u, 48u})
    note += big(tag, 2) + big(static_cast<uint32_t>(type), 2) + big(1, 4) + big(tag == 33 ? 44 : 52, 4);
  note += big(0, 4);
  for (const int v : {of_33, of_48}) note += big(static_cast<uint32_t>(v), 4) + big(1000, 4);
  const std::string tiff = std::string("MM\0\x2a", 4) + big(8, 4) + big(1, 2) + big(0x8769, 2) + big(4, 2) +
                           big(1, 4) + big(26, 4) + big(0, 4) + big(1, 2) + big(0x927c, 2) + big(7, 2) +
                           big(static_cast<uint32_t>(note.size()), 4) + big(44, 4) + big(0, 4) + note;
  return jpeg_segment(0xe1, std::string("Exif\0\0", 6) + tiff);
}

std::string apple_map(int code, const std::string& more = "") {
  return with(map_of(4, 4, true, flat(code)),
              xmp_segment("<r:Description xmlns:g='http://ns.apple.com/HDRGainMap/1.0/' "
                          "g:HDRGainMapVersion='65536'>" +
                          more + "</r:Description>"));
}

TEST(JpegReader, AnApplesMapHasItsPublishedLight) {
  const std::string base = jpeg_of(16, 16, flat(90));
  const double sdr = light_of_srgb(90 / 255.0);
  struct Case {
    int of_33, of_48;
    double stops;
  };
  for (const Case& c : {Case{0, 5, 1.7}, Case{0, 1000, 1.5}, Case{1000, 0, 3}, Case{1568, 10, 2.3},
                        Case{1000, 1000, 2}, Case{1000, 9000, 0}, Case{999, -100, 3.8}}) {
    const std::string file = with(base, apple_exif(c.of_33, c.of_48));
    ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(file + apple_map(255)));
    EXPECT_NEAR(component(image, 9, 9, 1) / sdr, std::exp2(c.stops), 1e-5) << c.of_33 << ' ' << c.of_48;
    EXPECT_NEAR(image.peak, std::exp2(c.stops), 1e-10);
    EXPECT_EQ(image.light, PictureLight::kHdr);
    ASSERT_OK_AND_ASSIGN(const Image half, read_jpeg_bytes(file + apple_map(128)));
    const double gain = std::pow((128 / 255.0 + 0.099) / 1.099, 1 / 0.45);
    EXPECT_NEAR(component(half, 9, 9, 1) / sdr, 1 + (std::exp2(c.stops) - 1) * gain, 1e-5);
    ASSERT_OK_AND_ASSIGN(const Image dark, read_jpeg_bytes(file + apple_map(10)));
    EXPECT_NEAR(component(dark, 9, 9, 1) / sdr, 1 + (std::exp2(c.stops) - 1) * 10 / 255 / 4.5, 1e-5);
  }
  // A later one names its headroom.
  const std::string named = "<g:HDRGainMapHeadroom>4.532783</g:HDRGainMapHeadroom>";
  ASSERT_OK_AND_ASSIGN(const Image image,
                       read_jpeg_bytes(with(base, apple_exif(1000, 0)) + apple_map(255, named)));
  EXPECT_NEAR(image.peak, 4.532783, 1e-10);
  EXPECT_NEAR(component(image, 0, 0, 2) / sdr, 4.532783, 1e-5);
}

TEST(JpegReader, AnApplesMapNeedsItsHeadroom) {
  const std::string base = jpeg_of(16, 16, flat(90));
  for (const std::string& file :
       {base + apple_map(255), with(base, apple_exif(1000, 0, 9)) + apple_map(255),
        base + apple_map(255, "<g:HDRGainMapHeadroom>0.5</g:HDRGainMapHeadroom>"),
        base + apple_map(255, "<g:HDRGainMapHeadroom>inf</g:HDRGainMapHeadroom>")}) {
    EXPECT_TRUE(says(why_unused(file), "Apple's kind of map needs a headroom"));
  }
  EXPECT_TRUE(says(why_unused(with(base, apple_exif(1000, -9000000)) + apple_map(255)), "headroom"));
}

// A square of `components` components in this colour space.
std::string jpeg_in(J_COLOR_SPACE space, int components,
                    const std::function<void(jpeg_compress_struct&)>& change = {}, uint32_t side = 8,
                    const CodeAt& code = flat(90)) {
  jpeg_compress_struct codec{};
  jpeg_error_mgr errors{};
  codec.err = jpeg_std_error(&errors);
  jpeg_create_compress(&codec);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&codec, &bytes, &size);
  codec.image_width = codec.image_height = side;
  codec.input_components = components;
  codec.in_color_space = space;
  jpeg_set_defaults(&codec);
  if (change) change(codec);
  jpeg_start_compress(&codec, TRUE);
  std::vector<unsigned char> row;
  for (uint32_t y = 0; y < side; ++y) {
    row.clear();
    for (uint32_t x = 0; x < side; ++x) {
      for (int c = 0; c < components; ++c) row.push_back(static_cast<unsigned char>(code(x, y, c)));
    }
    JSAMPROW at = row.data();
    jpeg_write_scanlines(&codec, &at, 1);
  }
  jpeg_finish_compress(&codec);
  jpeg_destroy_compress(&codec);
  const std::string file(reinterpret_cast<char*>(bytes), size);
  std::free(bytes);
  return file;
}

void progressive(jpeg_compress_struct& codec) { jpeg_simple_progression(&codec); }

TEST(JpegReader, OtherColoursAreRefusedByName) {
  EXPECT_REFUSED(kInvalidArgument, "file: the picture has 2 components; Candela reads grey and RGB",
                 read_jpeg_bytes(jpeg_in(JCS_UNKNOWN, 2)));
  EXPECT_TRUE(says(why_unused(joined(jpeg_of(8, 8, flat(1)), jpeg_in(JCS_CMYK, 4), stops_of(1))),
                   "the gain map is in CMYK"));
}

// Each scan takes the time of the whole picture.
TEST(JpegReader, ScansAreCounted) {
  const std::string file = jpeg_in(JCS_RGB, 3, progressive);
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(file));
  EXPECT_NEAR(component(image, 7, 7, 1), 0.1022, 1e-3);  // of code 90
  const size_t last = file.rfind("\xff\xda");
  std::string scans;
  for (int i = 0; i < 600; ++i) scans += file.substr(last, file.size() - 2 - last);
  EXPECT_REFUSED(kInvalidArgument, "file: damaged JPEG file: it has more than 500 scans",
                 read_jpeg_bytes(file.substr(0, last) + scans + "\xff\xd9"));
}

TEST(JpegReader, LimitsHoldBeforeMemoryIsTaken) {
  const std::string base = jpeg_of(40, 8, flat(1)), map = map_of(64, 8, true, flat(1));
  EXPECT_REFUSED(kResourceExhausted, "the image is 40x8 pixels; the limit is 32 on a side",
                 read_jpeg_bytes(base, {}, {.max_dimension = 32}));
  EXPECT_TRUE(says(why_unused(joined(base, map, stops_of(1)), {.max_dimension = 48}),
                   "the gain map is 64x8 pixels; the limit is 48 on a side"));
  EXPECT_REFUSED(kResourceExhausted, "--max-pixels allows 100",
                 read_jpeg_bytes(base, {}, {.max_pixels = 100}));
  // The size of the frame, 65000 x 65000, is all that is wrong.
  std::string huge = base;
  huge.replace(huge.find("\xff\xc0") + 5, 4, "\xfd\xe8\xfd\xe8");
  EXPECT_REFUSED(kResourceExhausted, "file: the image is 65000x65000 pixels", read_jpeg_bytes(huge));
}

TEST(JpegReader, AnUnfinishedFileIsNamed) {
  const std::string file = jpeg_of(64, 64, noise);
  EXPECT_REFUSED(kInvalidArgument, "file: damaged JPEG file: Premature end of JPEG file; --incomplete fill",
                 read_jpeg_bytes(file.substr(0, file.size() / 2)));
  ASSERT_OK_AND_ASSIGN(const Image image,
                       read_jpeg_bytes(file.substr(0, file.size() / 2), {.fills_gaps = true}));
  EXPECT_GT(image.missing_pixels, 0u);
  EXPECT_LT(image.missing_pixels, 64u * 64);
  EXPECT_EQ(component(image, 0, 0, 3), 1);
  EXPECT_EQ(component(image, 0, 63, 3), 0);
  EXPECT_REFUSED(kInvalidArgument, "damaged JPEG file", read_jpeg_bytes(file.substr(0, 30)));
  EXPECT_REFUSED(kInvalidArgument, "file: damaged JPEG file: the file ends before its first scan",
                 read_jpeg_bytes(std::string("\xff\xd8\xff\xe0\0\2", 6)));
}

TEST(JpegReader, WithoutItsEndMarkAPictureIsWhole) {
  const auto of_three_scans = [](jpeg_compress_struct& codec) {
    static constexpr jpeg_scan_info kScans[] = {
        {1, {0}, 0, 63, 0, 0}, {1, {1}, 0, 63, 0, 0}, {1, {2}, 0, 63, 0, 0}};
    codec.scan_info = kScans;
    codec.num_scans = 3;
  };
  const auto with_restarts = [](jpeg_compress_struct& codec) { codec.restart_interval = 2; };
  for (const std::function<void(jpeg_compress_struct&)>& kind :
       {std::function<void(jpeg_compress_struct&)>(), {of_three_scans}, {progressive}, {with_restarts}}) {
    const std::string file = jpeg_in(JCS_RGB, 3, kind, 40, noise);
    ASSERT_OK_AND_ASSIGN(const Image whole, read_jpeg_bytes(file));
    for (const bool fills_gaps : {true, false}) {
      ASSERT_OK_AND_ASSIGN(const Image image,
                           read_jpeg_bytes(file.substr(0, file.size() - 2), {.fills_gaps = fills_gaps}));
      EXPECT_TRUE(same_pixels(image, whole));
      EXPECT_EQ(image.missing_pixels, 0u);
      EXPECT_TRUE(image.notes.empty());
    }
    // Without its last scan, and in the middle of it, it is not.
    for (const size_t size : {file.rfind("\xff\xda"), file.size() - 30}) {
      EXPECT_REFUSED(kInvalidArgument, "file: damaged JPEG file: ", read_jpeg_bytes(file.substr(0, size)));
    }
  }
  // Of an arithmetic code nobody knows.
  const auto arithmetic = [](jpeg_compress_struct& codec) { codec.arith_code = TRUE; };
  const std::string file = jpeg_in(JCS_RGB, 3, arithmetic, 40, noise);
  ASSERT_OK_AND_ASSIGN(const Image whole, read_jpeg_bytes(file));
  EXPECT_REFUSED(kInvalidArgument, "Premature end of JPEG file; --incomplete fill",
                 read_jpeg_bytes(file.substr(0, file.size() - 2)));
}

// As sharp as the scans that are there make it.
TEST(JpegReader, AnUnfinishedProgressivePictureIsFilledIn) {
  const auto smooth = [](uint32_t x, uint32_t y, int c) { return static_cast<int>(40 + 3 * x + y + 9 * c); };
  const std::string file = jpeg_in(JCS_RGB, 3, progressive, 40, smooth);
  ASSERT_OK_AND_ASSIGN(const Image whole, read_jpeg_bytes(file));
  const size_t second = file.find("\xff\xda", file.find("\xff\xda") + 2);
  for (const size_t size : {second, file.rfind("\xff\xda"), file.size() - 4}) {
    const std::string cut = file.substr(0, size);
    EXPECT_REFUSED(kInvalidArgument, "Premature end of JPEG file; --incomplete fill", read_jpeg_bytes(cut));
    ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(cut, {.fills_gaps = true}));
    EXPECT_EQ(image.missing_pixels, 0u);
    EXPECT_TRUE(has_note(image, "Premature end of JPEG file; detail or colour of later scans is missing"));
    for (uint32_t i = 0; i < 40; ++i) {
      EXPECT_NEAR(component(image, i, 39 - i, 1), component(whole, i, 39 - i, 1), 0.05) << i;
    }
  }
  // In the middle of a segment between two scans.
  ASSERT_OK_AND_ASSIGN(const Image first, read_jpeg_bytes(file.substr(0, second - 5), {.fills_gaps = true}));
  EXPECT_EQ(first.missing_pixels, 0u);
  // The rows of blocks that the first scan has.
  const std::string other = jpeg_in(JCS_RGB, 3, progressive, 64, noise);
  ASSERT_OK_AND_ASSIGN(const Image part,
                       read_jpeg_bytes(other.substr(0, other.find("\xff\xda") + 30), {.fills_gaps = true}));
  EXPECT_GT(part.missing_pixels, 0u);
  EXPECT_EQ(part.missing_pixels % (16 * 64), 0u);  // its blocks have 16 rows
  EXPECT_EQ(component(part, 0, 0, 3), 1);
  EXPECT_EQ(component(part, 0, 63, 3), 0);
}

// What there is of an unfinished picture has the pixels of the whole one.
TEST(JpegReader, EveryRowThatIsThereIsFilledIn) {
  const std::string file = jpeg_of(40, 40, noise);
  ASSERT_OK_AND_ASSIGN(const Image whole, read_jpeg_bytes(file));
  uint64_t before = 40 * 40;
  for (size_t size = file.size() / 3; size < file.size(); size += 11) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(file.substr(0, size), {.fills_gaps = true}));
    EXPECT_LE(image.missing_pixels, before);
    before = image.missing_pixels;
    const uint32_t rows = 40 - static_cast<uint32_t>(image.missing_pixels / 40);
    EXPECT_EQ(rows % 8, 0u);
    for (uint32_t y = 0; y < 40; ++y) EXPECT_EQ(component(image, 7, y, 3), y < rows) << y;
    for (uint32_t y = 0; y < rows; ++y) EXPECT_EQ(component(image, 7, y, 1), component(whole, 7, y, 1));
  }
  EXPECT_LE(before, 40u * 8);
}

TEST(JpegReader, OtherKindsAreRefusedByName) {
  const std::string file = jpeg_of(8, 8, flat(90));
  const auto frame = [&](char marker, char bits) {
    std::string other = file;
    other[file.find("\xff\xc0") + 1] = marker;
    other[file.find("\xff\xc0") + 4] = bits;
    return read_jpeg_bytes(other);
  };
  EXPECT_REFUSED(kInvalidArgument,
                 "file: this is a JPEG of 12 bits; Candela reads baseline and progressive JPEGs of 8 bits; "
                 "convert it to PNG",
                 frame('\xc1', 12));
  EXPECT_REFUSED(kInvalidArgument, "file: this is a lossless JPEG of 16 bits", frame('\xc3', 16));
  EXPECT_REFUSED(kInvalidArgument, "file: this is a hierarchical JPEG of 8 bits", frame('\xc5', 8));
  EXPECT_REFUSED(kInvalidArgument, "file: this is a JPEG-LS file of 8 bits", frame('\xf7', 8));
  const std::string box("\0\0\0\x0c", 4);
  for (const std::string& jp2 : {box + "jP  \r\n\x87\n", std::string("\xff\x4f\xff\x51\0\0", 6)}) {
    EXPECT_REFUSED(kInvalidArgument, "file: Candela does not read JPEG 2000; convert it to PNG or AVIF",
                   read_jpeg_bytes(jp2));
  }
  for (const std::string& jxl : {box + "JXL \r\n\x87\n", std::string("\xff\x0a\x12")}) {
    EXPECT_REFUSED(kInvalidArgument, "file: Candela does not read JPEG XL", read_jpeg_bytes(jxl));
  }
  EXPECT_REFUSED(kInvalidArgument, "file: Candela does not read WebP", read_jpeg_bytes("RIFFabcdWEBPVP8 "));
  EXPECT_REFUSED(kInvalidArgument, "file: Candela does not read HEIC", read_jpeg_bytes(box + "ftypheic\0\0"));
  EXPECT_REFUSED(kInvalidArgument, "file: not an OpenEXR", read_jpeg_bytes("RIFFabcdAVI LIST"));
}

TEST(JpegReader, SurvivesAnyDamage) {
  const std::string files[] = {
      joined(jpeg_of(24, 16, noise), map_of(12, 8, true, noise), stops_of(3)),
      joined(
          with(jpeg_of(17, 9, noise),
               jpeg_segment(0xe1, std::string("Exif\0\0MM\0\x2a\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0\6", 26) +
                                      std::string(6, '\0'))),
          map_of(17, 9, false, noise), three_channels()),
      with(jpeg_of(16, 8, noise), apple_exif(1000, 5)) + apple_map(77),
      jpeg_in(JCS_RGB, 3, progressive, 24, noise)};
  bool fills_gaps = false;
  const auto try_it = [&fills_gaps](const std::string& bytes) {
    fills_gaps = !fills_gaps;
    const absl::StatusOr<Image> image =
        read_jpeg_bytes(bytes, {.fills_gaps = fills_gaps}, {.max_dimension = 256});
    if (!image.ok()) {
      EXPECT_TRUE(absl::IsInvalidArgument(image.status()) || absl::IsResourceExhausted(image.status()))
          << image.status();
      EXPECT_TRUE(absl::StartsWith(image.status().message(), "file: ")) << image.status();
      return;
    }
    for (uint32_t y = 0; y < image->height; ++y) {
      for (uint32_t x = 0; x < image->width; ++x) EXPECT_TRUE(std::isfinite(component(*image, x, y, 0)));
    }
  };
  std::mt19937 random(1);
  for (const std::string& file : files) {
    for (size_t size = 0; size < file.size(); size += 5) try_it(file.substr(0, size));
    for (size_t at = 0; at < file.size(); at += 4) {
      std::string one = file;
      one[at] = static_cast<char>(one[at] ^ 1 << random() % 8);
      try_it(one);
      std::string more = file;
      for (int i = 0; i < 4; ++i) more[random() % more.size()] = static_cast<char>(random());
      try_it(more);
    }
  }
}

// The bytes of gain-map JPEG files, read back by a parser of their own.

uint32_t number(const std::string& bytes, size_t at, size_t size) {
  uint32_t v = 0;
  for (size_t i = 0; i < size; ++i) v = v << 8 | static_cast<uint8_t>(bytes.at(at + i));
  return v;
}

// A segment's place in the file, and its bytes behind the length.
struct Part {
  int marker;
  size_t at;
  std::string body;
};

// Those up to the first scan, which is the last.
std::vector<Part> parts_of(const std::string& file, size_t at = 0) {
  EXPECT_EQ(number(file, at, 2), 0xffd8u);
  std::vector<Part> parts;
  for (at += 2; parts.empty() || parts.back().marker != 0xda;) {
    EXPECT_EQ(file.at(at), '\xff');
    const size_t length = number(file, at + 2, 2);
    parts.push_back({static_cast<uint8_t>(file.at(at + 1)), at, file.substr(at + 4, length - 2)});
    at += 2 + length;
  }
  return parts;
}

// The one part with this name, which ends with a zero. The result has no name.
Part named(const std::vector<Part>& parts, int marker, const std::string& name) {
  Part found{};
  int count = 0;
  for (const Part& part : parts) {
    if (part.marker != marker || part.body.substr(0, name.size() + 1) != name + '\0') continue;
    found = {marker, part.at, part.body.substr(name.size() + 1)};
    ++count;
  }
  EXPECT_EQ(count, 1) << name;
  return found;
}

constexpr char kXmp[] = "http://ns.adobe.com/xap/1.0/", kIso[] = "urn:iso:std:iso:ts:21496:-1";

struct Entry {
  uint32_t kind, size, offset;
};

// The entries of an MPF, by its own offsets.
std::vector<Entry> entries_of(const std::string& mpf) {
  EXPECT_EQ(mpf.substr(0, 4), std::string("MM\0\x2a", 4));
  const size_t index = number(mpf, 4, 4);
  std::map<uint32_t, std::pair<uint32_t, uint32_t>> tags;  // count and value
  for (uint32_t i = 0; i < number(mpf, index, 2); ++i) {
    const size_t at = index + 2 + 12 * i;
    tags[number(mpf, at, 2)] = {number(mpf, at + 4, 4), number(mpf, at + 8, 4)};
  }
  EXPECT_EQ(tags[0xb000].second, 0x30313030u);  // "0100"
  EXPECT_EQ(tags[0xb001].second * 16, tags[0xb002].first);
  std::vector<Entry> entries;
  for (uint32_t i = 0; i < tags[0xb001].second; ++i) {
    const size_t at = tags[0xb002].second + 16 * i;
    entries.push_back({number(mpf, at, 4), number(mpf, at + 4, 4), number(mpf, at + 8, 4)});
  }
  return entries;
}

double fraction(const std::string& bytes, size_t at) {
  return static_cast<int32_t>(number(bytes, at, 4)) / static_cast<double>(number(bytes, at + 4, 4));
}

// The text between `before` and `after`.
std::string between(const std::string& text, const std::string& before, const std::string& after) {
  const size_t at = text.find(before);
  if (at == std::string::npos) return "no " + before;
  return text.substr(at + before.size(), text.find(after, at + before.size()) - at - before.size());
}

int grey(uint32_t x, uint32_t y, int) { return static_cast<int>((x * 7 + y * 3) % 256); }

TEST(GainMap, TheBaseStaysByteForByte) {
  const std::string base = jpeg_of(40, 24, grey), map = map_of(40, 24, true, grey);
  const std::string file = joined(base, map, stops_of(2));
  const std::vector<Part> before = parts_of(base), after = parts_of(file);
  // APP0 stays the first, three segments follow it, and all that was behind it stays behind them.
  ASSERT_EQ(after.size(), before.size() + 3);
  EXPECT_EQ(file.substr(0, before[1].at), base.substr(0, before[1].at));
  EXPECT_EQ(file.substr(after[4].at, base.size() - before[1].at), base.substr(before[1].at));
  const std::vector<Part> of_map = parts_of(map);
  const size_t map_at = after[4].at + base.size() - before[1].at;
  const std::vector<Part> in_file = parts_of(file, map_at);
  EXPECT_EQ(file.substr(in_file[3].at), map.substr(of_map[1].at));
}

TEST(GainMap, MpfAndTheDirectoryFindTheMap) {
  const std::string base = jpeg_of(40, 24, grey), map = map_of(20, 12, true, grey);
  const std::string file = joined(base, map, stops_of(2));
  const std::vector<Part> parts = parts_of(file);
  const Part mpf = named(parts, 0xe2, "MPF");
  const std::vector<Entry> entries = entries_of(mpf.body);
  ASSERT_EQ(entries.size(), 2u);
  EXPECT_EQ(entries[0].kind, 0x030000u);
  EXPECT_EQ(entries[0].offset, 0u);
  EXPECT_EQ(entries[1].kind, 0u);
  const size_t map_at = mpf.at + 8 + entries[1].offset;  // marker, length and name before the mark
  EXPECT_EQ(file.substr(mpf.at + 8, 2), "MM");
  EXPECT_EQ(map_at, entries[0].size);
  EXPECT_EQ(map_at + entries[1].size, file.size());
  EXPECT_EQ(number(file, map_at - 2, 4), 0xffd9ffd8u);

  const std::string xmp = named(parts, 0xe1, kXmp).body;
  EXPECT_EQ(between(xmp, "hdrgm:Version=\"", "\""), "1.0");
  EXPECT_EQ(between(xmp, "Item:Length=\"", "\""), std::to_string(entries[1].size));
  EXPECT_LT(xmp.find("Item:Semantic=\"Primary\""), xmp.find("Item:Semantic=\"GainMap\""));
  EXPECT_EQ(named(parts, 0xe2, kIso).body, std::string(4, '\0'));
}

TEST(GainMap, OneChannelHasScalars) {
  GainMapMetadata metadata = stops_of(2.3);
  metadata.min_log2[0] = -0.7;
  metadata.offset_sdr[0] = 1.0 / 64;
  metadata.offset_hdr[0] = 1e-7;
  const std::string base = jpeg_of(8, 8, grey);
  const std::string file = joined(base, map_of(8, 8, true, grey), metadata);
  const std::vector<Part> parts = parts_of(file, entries_of(named(parts_of(file), 0xe2, "MPF").body)[0].size);
  const std::string iso = named(parts, 0xe2, kIso).body;
  ASSERT_EQ(iso.size(), 4 + 1 + 16 + 40u);
  EXPECT_EQ(iso.substr(0, 4), std::string(4, '\0'));
  EXPECT_EQ(iso[4], '\x40');
  const std::vector<double> expected = {0, 2.3, -0.7, 2.3, 1, 1.0 / 64, 1e-7};
  for (size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(fraction(iso, 5 + 8 * i), expected[i], 1e-9 * std::abs(expected[i])) << i;
  }
  EXPECT_EQ(number(iso, 5 + 8 * 5 + 4, 4), 64u);
  const std::string xmp = named(parts, 0xe1, kXmp).body;
  for (const auto& [name, value] : {std::pair("Version", "1.0"),
                                    {"GainMapMin", "-0.7"},
                                    {"GainMapMax", "2.3"},
                                    {"Gamma", "1"},
                                    {"OffsetSDR", "0.015625"},
                                    {"OffsetHDR", "0.0000001"},
                                    {"HDRCapacityMin", "0"},
                                    {"HDRCapacityMax", "2.3"},
                                    {"BaseRenditionIsHDR", "False"}}) {
    EXPECT_EQ(between(xmp, std::string("hdrgm:") + name + "=\"", "\""), value);
  }
}

TEST(GainMap, ThreeChannelsHaveSequences) {
  const GainMapMetadata metadata = {.min_log2 = {-1, -2, -3},
                                    .max_log2 = {1, 2, 3},
                                    .gamma = {1, 0.5, 2},
                                    .offset_sdr = {0.25, 0.5, 0.75},
                                    .offset_hdr = {0.125, 0.375, 0.625},
                                    .headroom_base_log2 = 0.5,
                                    .headroom_hdr_log2 = 2.5,
                                    .one_channel = false};
  const std::string file = joined(jpeg_of(8, 8, grey), map_of(8, 8, false, grey), metadata);
  const std::vector<Part> parts = parts_of(file, entries_of(named(parts_of(file), 0xe2, "MPF").body)[0].size);
  const std::string iso = named(parts, 0xe2, kIso).body;
  ASSERT_EQ(iso.size(), 4 + 1 + 16 + 3 * 40u);
  EXPECT_EQ(iso[4], '\xc0');
  EXPECT_EQ(fraction(iso, 5), 0.5);
  EXPECT_EQ(fraction(iso, 13), 2.5);
  for (size_t c = 0; c < 3; ++c) {
    const double expected[] = {metadata.min_log2[c], metadata.max_log2[c], metadata.gamma[c],
                               metadata.offset_sdr[c], metadata.offset_hdr[c]};
    for (size_t i = 0; i < 5; ++i)
      EXPECT_EQ(fraction(iso, 21 + 40 * c + 8 * i), expected[i]) << c << ' ' << i;
  }
  const std::string xmp = named(parts, 0xe1, kXmp).body;
  EXPECT_EQ(between(xmp, "<hdrgm:GainMapMin>", "</hdrgm:GainMapMin>"),
            "<rdf:Seq><rdf:li>-1</rdf:li><rdf:li>-2</rdf:li><rdf:li>-3</rdf:li></rdf:Seq>");
  EXPECT_EQ(between(xmp, "<hdrgm:OffsetHDR>", "</hdrgm:OffsetHDR>"),
            "<rdf:Seq><rdf:li>0.125</rdf:li><rdf:li>0.375</rdf:li><rdf:li>0.625</rdf:li></rdf:Seq>");
  EXPECT_EQ(between(xmp, "hdrgm:HDRCapacityMax=\"", "\""), "2.5");
}

TEST(GainMap, TheSameInputsGiveTheSameBytes) {
  const auto once = [] { return joined(jpeg_of(16, 16, grey), map_of(16, 16, false, grey), stops_of(1)); };
  EXPECT_EQ(once(), once());
}

TEST(GainMap, RefusesWhatIsNoPictureOrNoMap) {
  const std::string base = jpeg_of(8, 8, grey), map = map_of(8, 8, true, grey);
  EXPECT_REFUSED(kInvalidArgument, "the base: no JPEG picture begins there",
                 join_gain_map("x", map, stops_of(1)));
  EXPECT_REFUSED(kInvalidArgument, "the gain map is not one whole JPEG picture",
                 join_gain_map(base, map.substr(0, map.size() - 2), stops_of(1)));
  EXPECT_REFUSED(kInvalidArgument, "the base is not one whole JPEG picture",
                 join_gain_map(base + "x", map, stops_of(1)));
  EXPECT_REFUSED(kInvalidArgument, "the maximum of the gain map is -1; it must be within 0 .. 64",
                 join_gain_map(base, map, stops_of(-1)));
  GainMapMetadata metadata = stops_of(1);
  metadata.gamma[0] = std::nan("");
  EXPECT_REFUSED(kInvalidArgument, "the gamma of the gain map is nan", join_gain_map(base, map, metadata));
  EXPECT_REFUSED(kInternal, "a gain map of 4x4 pixels has 3 codes; it must have 16",
                 encode_gain_map(std::vector<uint8_t>(3), 4, 4, true));
}

}  // namespace
}  // namespace candela
