// TIFF files of every kind, written by libtiff.
#include <gtest/gtest.h>
#include <half.h>
#include <lcms2.h>
#include <tiffio.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/image/color.h"
#include "client/image/describe.h"
#include "client/image/image.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

struct TiffKind {
  uint32_t width = 21, height = 13;
  uint16_t bits = 8, samples = 3, format = SAMPLEFORMAT_UINT, photometric = PHOTOMETRIC_RGB;
  uint16_t planes = PLANARCONFIG_CONTIG, compression = COMPRESSION_NONE, orientation = ORIENTATION_TOPLEFT;
  uint32_t tile = 0, strip_rows = 4;  // a tile of 0: strips
  const char* mode = "w";
  std::vector<uint16_t> extras{};
  std::function<void(TIFF*)> more = [](TIFF*) {};  // sets other fields
  // The sample's code or float.
  std::function<double(uint32_t x, uint32_t y, int sample)> value = [](uint32_t x, uint32_t y, int s) {
    return x * 5 + y * 17 + s * 3;
  };
};

double usual_value(const TiffKind& kind, uint32_t x, uint32_t y, int sample) {
  const double value = kind.value(x, y, sample);
  return kind.format == SAMPLEFORMAT_IEEEFP ? value : std::fmod(value, std::ldexp(1, kind.bits));
}

// Values of `kind`, packed as libtiff takes them.
std::vector<uint8_t> packed(const TiffKind& kind, const std::vector<double>& values) {
  std::vector<uint8_t> bytes;
  uint64_t held = 0;
  int bits = 0;
  for (const double value : values) {
    if (kind.bits == 16 || kind.bits == 32) {
      uint32_t code = static_cast<uint32_t>(static_cast<int64_t>(value));
      if (kind.format == SAMPLEFORMAT_IEEEFP) {
        const auto number = static_cast<float>(value);
        code = kind.bits == 16 ? imath_float_to_half(number) : std::bit_cast<uint32_t>(number);
      }
      for (int i = 0; i < kind.bits; i += 8) bytes.push_back(static_cast<uint8_t>(code >> i));
      continue;
    }
    held = held << kind.bits | static_cast<uint64_t>(value);
    for (bits += kind.bits; bits >= 8; bits -= 8) bytes.push_back(static_cast<uint8_t>(held >> (bits - 8)));
  }
  if (bits > 0) bytes.push_back(static_cast<uint8_t>(held << (8 - bits)));
  return bytes;
}

void write_picture(TIFF* tiff, const TiffKind& kind) {
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, kind.width);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kind.height);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, kind.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, kind.samples);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, kind.format);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, kind.photometric);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, kind.planes);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, kind.compression);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, kind.orientation);
  if (!kind.extras.empty()) {
    TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, static_cast<uint16_t>(kind.extras.size()), kind.extras.data());
  }
  if (kind.tile > 0) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kind.tile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, kind.tile);
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, kind.strip_rows);
  }
  kind.more(tiff);
  const bool separate = kind.planes == PLANARCONFIG_SEPARATE;
  const uint32_t step_x = kind.tile > 0 ? kind.tile : kind.width;
  const uint32_t step_y = kind.tile > 0 ? kind.tile : kind.strip_rows;
  for (uint16_t plane = 0; plane < (separate ? kind.samples : 1); ++plane) {
    for (uint32_t y = 0; y < kind.height; y += step_y) {
      for (uint32_t x = 0; x < kind.width; x += step_x) {
        std::vector<uint8_t> bytes;
        const uint32_t rows = kind.tile > 0 ? step_y : std::min(step_y, kind.height - y);
        for (uint32_t i = 0; i < rows; ++i) {  // each row begins with a byte of its own
          std::vector<double> values;
          for (uint32_t k = 0; k < step_x; ++k) {
            for (int s = plane; s < (separate ? plane + 1 : kind.samples); ++s) {
              values.push_back(usual_value(kind, x + k, y + i, s));
            }
          }
          const std::vector<uint8_t> row = packed(kind, values);
          bytes.insert(bytes.end(), row.begin(), row.end());
        }
        const auto size = static_cast<tmsize_t>(bytes.size());
        const tmsize_t written =
            kind.tile > 0 ? TIFFWriteTile(tiff, bytes.data(), x, y, 0, plane)
                          : TIFFWriteEncodedStrip(tiff, TIFFComputeStrip(tiff, y, plane), bytes.data(), size);
        ASSERT_EQ(written, size);
      }
    }
  }
  ASSERT_EQ(TIFFWriteDirectory(tiff), 1);
}

// A file of these pictures.
std::string tiff_of(const std::vector<TiffKind>& pictures) {
  TIFFSetWarningHandler(nullptr);  // of old compressions
  const TemporaryFolder folder;
  const std::string path = folder.path("made.tif");
  TIFF* const tiff = TIFFOpen(path.c_str(), pictures[0].mode);
  for (const TiffKind& kind : pictures) write_picture(tiff, kind);
  TIFFClose(tiff);
  return read_file(path);
}

std::string tiff_of(const TiffKind& kind) { return tiff_of(std::vector{kind}); }

bool notes(const Image& image, const char* words) {
  return std::ranges::any_of(image.notes,
                             [&](const std::string& note) { return absl::StrContains(note, words); });
}

double decoded_srgb(double signal) { return to_linear(ColorCurve::kSrgb, signal); }

// The largest difference of R, G and B from the light of the file's codes.
double worst_of(const Image& image, const TiffKind& kind) {
  double worst = 0;
  for (uint32_t y = 0; y < kind.height; ++y) {
    for (uint32_t x = 0; x < kind.width; ++x) {
      for (int c = 0; c < 3; ++c) {
        const double value = usual_value(kind, x, y, kind.samples < 3 ? 0 : c);
        const double light =
            kind.format == SAMPLEFORMAT_IEEEFP ? value : decoded_srgb(value / (std::ldexp(1, kind.bits) - 1));
        worst = std::max(worst, std::abs(component(image, x, y, c) - light));
      }
    }
  }
  return worst;
}

TEST(TiffReader, EveryWayToStoreCodesGivesTheirLight) {
  for (const uint16_t bits : {1, 2, 4, 8, 10, 12, 14, 16}) {
    for (const uint16_t samples : {1, 3}) {
      for (const uint16_t planes : {PLANARCONFIG_CONTIG, PLANARCONFIG_SEPARATE}) {
        for (const uint32_t tile : {0, 16}) {
          for (const char* mode : {"wl", "wb", "wl8", "wb8"}) {
            TiffKind kind{.bits = bits, .samples = samples, .planes = planes, .tile = tile, .mode = mode};
            if (samples == 1) kind.photometric = PHOTOMETRIC_MINISBLACK;
            SCOPED_TRACE(absl::StrCat(bits, " bits, ", samples, " samples, planes ", planes, ", tile ", tile,
                                      ", ", mode));
            ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
            ASSERT_EQ(image.width, kind.width);
            ASSERT_EQ(image.height, kind.height);
            EXPECT_EQ(image.light, PictureLight::kSdr);
            EXPECT_EQ(image.signal, absl::StrCat(bits, " bits, sRGB, assumed"));
            EXPECT_FALSE(image.has_alpha);
            EXPECT_TRUE(image.notes.empty());
            EXPECT_LE(worst_of(image, kind), 1e-5);
          }
        }
      }
    }
  }
}

TEST(TiffReader, EveryCompressionOfLibtiffIsRead) {
  int tried = 0;
  for (const uint16_t compression :
       {COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_DEFLATE, COMPRESSION_PACKBITS,
        COMPRESSION_ZSTD, COMPRESSION_LERC, COMPRESSION_WEBP}) {
    if (TIFFIsCODECConfigured(compression) == 0) continue;
    for (const uint32_t tile : {0, 16}) {
      SCOPED_TRACE(absl::StrCat("compression ", compression, ", tile ", tile));
      TiffKind kind{.compression = compression, .tile = tile};
      if (compression == COMPRESSION_WEBP) {
        kind.more = [](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_WEBP_LOSSLESS, 1); };
      } else if (compression != COMPRESSION_PACKBITS && compression != COMPRESSION_LERC) {
        kind.more = [](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_PREDICTOR, PREDICTOR_HORIZONTAL); };
      }
      ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
      EXPECT_LE(worst_of(image, kind), 1e-5);
      ++tried;
    }
  }
  EXPECT_GE(tried, 8);  // those that libtiff always has, in strips and in tiles
}

TEST(TiffReader, FaxIsBlackAndWhite) {
  for (const uint16_t compression : {COMPRESSION_CCITTRLE, COMPRESSION_CCITTFAX3, COMPRESSION_CCITTFAX4}) {
    if (TIFFIsCODECConfigured(compression) == 0) continue;
    SCOPED_TRACE(absl::StrCat("compression ", compression));
    const TiffKind kind{.width = 64,
                        .bits = 1,
                        .samples = 1,
                        .photometric = PHOTOMETRIC_MINISWHITE,
                        .compression = compression,
                        .strip_rows = 13,
                        .value = [](uint32_t x, uint32_t y, int) { return (x / 3 + y / 2) % 2; }};
    ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
    int wrong = 0;
    for (uint32_t y = 0; y < kind.height; ++y) {
      for (uint32_t x = 0; x < kind.width; ++x) {
        wrong += component(image, x, y, 1) != static_cast<float>(1 - kind.value(x, y, 0));
      }
    }
    EXPECT_EQ(wrong, 0);
  }
}

TEST(TiffReader, FloatsAreLightOfAScene) {
  for (const uint16_t bits : {16, 32}) {
    for (const uint16_t samples : {1, 3}) {
      for (const uint16_t planes : {PLANARCONFIG_CONTIG, PLANARCONFIG_SEPARATE}) {
        for (const char* mode : {"wl", "wb"}) {
          TiffKind kind{.bits = bits,
                        .samples = samples,
                        .format = SAMPLEFORMAT_IEEEFP,
                        .planes = planes,
                        .compression = COMPRESSION_LZW,
                        .mode = mode,
                        .value = [](uint32_t x, uint32_t y, int s) { return x * 8.0 - y + s * 0.25; }};
          if (samples == 1) kind.photometric = PHOTOMETRIC_MINISBLACK;
          if (mode == std::string("wl")) {  // libtiff 4.5 writes it wrongly of the other byte order
            kind.more = [](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_PREDICTOR, PREDICTOR_FLOATINGPOINT); };
          }
          SCOPED_TRACE(absl::StrCat(bits, " bits, ", samples, " samples, planes ", planes, ", ", mode));
          const std::string file = tiff_of(kind);
          ASSERT_OK_AND_ASSIGN(const Image image, read_signal(file));
          EXPECT_EQ(image.light, PictureLight::kScene);
          EXPECT_EQ(image.signal, "");
          EXPECT_EQ(worst_of(image, kind), 0);
          ASSERT_OK_AND_ASSIGN(const Image decoded, read_signal(file, {.transfer = SignalTransfer::kSrgb}));
          EXPECT_NEAR(component(decoded, 1, 0, 0), decoded_srgb(8), 1e-3);
        }
      }
    }
  }
}

TEST(TiffReader, WhiteMayBeZero) {
  TiffKind kind{.samples = 1, .photometric = PHOTOMETRIC_MINISWHITE};
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
  EXPECT_NEAR(component(image, 3, 2, 1), decoded_srgb(1 - usual_value(kind, 3, 2, 0) / 255), 1e-6);
}

TEST(TiffReader, APaletteHasCodesOf16BitsOrOf8) {
  for (const int factor : {257, 1}) {
    for (const uint16_t bits : {4, 8}) {
      std::array<std::vector<uint16_t>, 3> colors;
      for (int i = 0; i < 1 << bits; ++i) {
        for (int c = 0; c < 3; ++c) colors[c].push_back(static_cast<uint16_t>((i * (3 + c) % 256) * factor));
      }
      TiffKind kind{.bits = bits, .samples = 1, .photometric = PHOTOMETRIC_PALETTE};
      kind.more = [&](TIFF* tiff) {
        TIFFSetField(tiff, TIFFTAG_COLORMAP, colors[0].data(), colors[1].data(), colors[2].data());
      };
      ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
      const auto index = static_cast<size_t>(usual_value(kind, 7, 3, 0));
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(component(image, 7, 3, c), decoded_srgb(colors[c][index] / factor / 255.0), 1e-6)
            << factor;
      }
    }
  }
}

TEST(TiffReader, APictureIsUpright) {
  // Where the first row and the first column of the file are shown. Source: TIFF 6.0, section 8.
  struct Turn {
    uint16_t orientation;
    std::function<std::array<uint32_t, 2>(uint32_t x, uint32_t y, uint32_t right, uint32_t bottom)> place;
  };
  const Turn turns[] = {{ORIENTATION_TOPLEFT,
                         [](auto x, auto y, auto, auto) {
                           return std::array{x, y};
                         }},
                        {ORIENTATION_TOPRIGHT,
                         [](auto x, auto y, auto right, auto) {
                           return std::array{right - x, y};
                         }},
                        {ORIENTATION_BOTRIGHT,
                         [](auto x, auto y, auto right, auto bottom) {
                           return std::array{right - x, bottom - y};
                         }},
                        {ORIENTATION_BOTLEFT,
                         [](auto x, auto y, auto, auto bottom) {
                           return std::array{x, bottom - y};
                         }},
                        {ORIENTATION_LEFTTOP,
                         [](auto x, auto y, auto, auto) {
                           return std::array{y, x};
                         }},
                        {ORIENTATION_RIGHTTOP,
                         [](auto x, auto y, auto right, auto) {
                           return std::array{right - y, x};
                         }},
                        {ORIENTATION_RIGHTBOT,
                         [](auto x, auto y, auto right, auto bottom) {
                           return std::array{right - y, bottom - x};
                         }},
                        {ORIENTATION_LEFTBOT, [](auto x, auto y, auto, auto bottom) {
                           return std::array{y, bottom - x};
                         }}};
  for (const Turn& turn : turns) {
    for (const uint32_t tile : {0, 16}) {
      TiffKind kind{.orientation = turn.orientation, .tile = tile};
      kind.more = [](TIFF* tiff) {
        TIFFSetField(tiff, TIFFTAG_XRESOLUTION, 100.0);
        TIFFSetField(tiff, TIFFTAG_YRESOLUTION, 200.0);
      };
      ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
      const bool swaps = turn.orientation >= ORIENTATION_LEFTTOP;
      ASSERT_EQ(image.width, swaps ? kind.height : kind.width);
      ASSERT_EQ(image.height, swaps ? kind.width : kind.height);
      EXPECT_EQ(image.pixel_aspect, swaps ? 0.5 : 2);
      double worst = 0;
      for (uint32_t y = 0; y < kind.height; ++y) {
        for (uint32_t x = 0; x < kind.width; ++x) {
          const auto [to_x, to_y] = turn.place(x, y, image.width - 1, image.height - 1);
          const double light = decoded_srgb(usual_value(kind, x, y, 1) / 255);
          worst = std::max(worst, std::abs(component(image, to_x, to_y, 1) - light));
        }
      }
      EXPECT_LE(worst, 1e-6) << turn.orientation;
    }
  }
}

TEST(TiffReader, AlphaIsStraightOrHasMultipliedTheCodes) {
  for (const uint16_t alpha : {EXTRASAMPLE_UNASSALPHA, EXTRASAMPLE_ASSOCALPHA}) {
    for (const uint16_t planes : {PLANARCONFIG_CONTIG, PLANARCONFIG_SEPARATE}) {
      const bool associated = alpha == EXTRASAMPLE_ASSOCALPHA;
      // Another sample stands before it.
      TiffKind kind{.samples = 5, .planes = planes, .extras = {EXTRASAMPLE_UNSPECIFIED, alpha}};
      kind.value = [](uint32_t, uint32_t, int s) { return std::array{80, 40, 20, 7, 160}[s]; };
      ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
      EXPECT_TRUE(image.has_alpha);
      const double a = 160 / 255.0;
      EXPECT_NEAR(component(image, 2, 2, 3), a, 1e-6);
      for (int c = 0; c < 3; ++c) {
        const double code = kind.value(0, 0, c) / 255;
        EXPECT_NEAR(component(image, 2, 2, c), a * decoded_srgb(associated ? code / a : code), 1e-4);
      }
      EXPECT_TRUE(notes(image, "1 of its 5 samples a pixel are neither colour nor alpha"));

      kind.format = SAMPLEFORMAT_IEEEFP;
      kind.bits = 32;
      ASSERT_OK_AND_ASSIGN(const Image floats, read_signal(tiff_of(kind)));
      EXPECT_EQ(component(floats, 2, 2, 3), 160);
      EXPECT_EQ(component(floats, 2, 2, 0), associated ? 80 : 80 * 160);
    }
  }
  TiffKind grey{.samples = 2, .photometric = PHOTOMETRIC_MINISBLACK, .extras = {EXTRASAMPLE_UNASSALPHA}};
  grey.value = [](uint32_t, uint32_t, int s) { return s == 0 ? 80 : 51; };
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(grey)));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(image, 0, 0, c), 0.2 * decoded_srgb(80 / 255.0), 1e-6);
  EXPECT_NEAR(component(image, 0, 0, 3), 0.2, 1e-6);
}

TEST(TiffReader, YcbcrIsReadAsRgb) {
  const auto smooth = [](uint32_t x, uint32_t, int s) { return 60 + x * 4 + s * 20; };
  TiffKind jpeg{.width = 32,
                .height = 16,
                .photometric = PHOTOMETRIC_YCBCR,
                .compression = COMPRESSION_JPEG,
                .strip_rows = 16,
                .value = smooth};
  jpeg.more = [](TIFF* tiff) {
    TIFFSetField(tiff, TIFFTAG_JPEGQUALITY, 100);
    TIFFSetField(tiff, TIFFTAG_JPEGCOLORMODE, JPEGCOLORMODE_RGB);
  };
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(jpeg)));
  EXPECT_LE(worst_of(image, jpeg), 0.02);

  // Y, Cb, Cr of grey: each is as bright as its Y.
  TiffKind plain{.photometric = PHOTOMETRIC_YCBCR,
                 .value = [](uint32_t x, uint32_t, int s) { return s == 0 ? 16.0 + x : 128.0; }};
  plain.more = [](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_YCBCRSUBSAMPLING, 1, 1); };
  plain.orientation = ORIENTATION_BOTLEFT;
  ASSERT_OK_AND_ASSIGN(const Image upright, read_signal(tiff_of(plain)));
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(upright, 20, 3, c), decoded_srgb(36 / 255.0), 0.003);
}

TEST(TiffReader, LogLuvIsLightOfXyz) {
  TiffKind kind{.bits = 32,
                .format = SAMPLEFORMAT_IEEEFP,
                .photometric = PHOTOMETRIC_LOGLUV,
                .compression = COMPRESSION_SGILOG,
                .value = [](uint32_t x, uint32_t y, int s) { return (x + 1) * (y + 1) * 0.5 + s * 0.1; }};
  kind.more = [](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_SGILOGDATAFMT, SGILOGDATAFMT_FLOAT); };
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
  EXPECT_EQ(image.light, PictureLight::kScene);
  ASSERT_TRUE(image.chromaticities.has_value());
  EXPECT_EQ(*image.chromaticities, kXyz.xy);
  EXPECT_NEAR(component(image, 10, 10, 1) / kind.value(10, 10, 1), 1, 0.01);
}

// ICC profiles. icc_profile_test.cc compares those of codes with lcms2.

using Profile = std::unique_ptr<void, decltype(&cmsCloseProfile)>;

// Of Adobe RGB (1998)'s primaries and this curve, which lives as long as the call.
Profile adobe_profile(cmsToneCurve* curve) {
  const cmsCIExyY white = {0.3127, 0.3290, 1};
  const cmsCIExyYTRIPLE primaries = {{0.64, 0.33, 1}, {0.21, 0.71, 1}, {0.15, 0.06, 1}};
  cmsToneCurve* const curves[] = {curve, curve, curve};
  Profile profile(cmsCreateRGBProfile(&white, &primaries, curves), &cmsCloseProfile);
  cmsFreeToneCurve(curve);
  return profile;
}

std::string bytes_of(const Profile& profile) {
  cmsUInt32Number size = 0;
  cmsSaveProfileToMem(profile.get(), nullptr, &size);
  std::string bytes(size, '\0');
  EXPECT_TRUE(cmsSaveProfileToMem(profile.get(), bytes.data(), &size));
  return bytes;
}

// The kind with the profile in it.
TiffKind with_profile(TiffKind kind, const std::string& profile) {
  kind.more = [profile](TIFF* tiff) {
    TIFFSetField(tiff, TIFFTAG_ICCPROFILE, static_cast<uint32_t>(profile.size()), profile.data());
  };
  return kind;
}

TEST(TiffReader, InksWithoutAProfileAreIdeal) {
  TiffKind kind{.samples = 5, .photometric = PHOTOMETRIC_SEPARATED, .extras = {EXTRASAMPLE_UNASSALPHA}};
  kind.value = [](uint32_t, uint32_t, int s) { return std::array{0, 51, 255, 102, 153}[s]; };
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
  EXPECT_TRUE(notes(image, "inks are taken as ideal"));
  const double signals[] = {0.6, 0.8 * 0.6, 0};
  for (int c = 0; c < 3; ++c) EXPECT_NEAR(component(image, 4, 4, c), 0.6 * decoded_srgb(signals[c]), 1e-4);
  EXPECT_NEAR(component(image, 4, 4, 3), 0.6, 1e-6);
}

TEST(TiffReader, AProfileSaysWhatFloatsAre) {
  TiffKind kind{.bits = 32, .format = SAMPLEFORMAT_IEEEFP, .value = [](uint32_t x, uint32_t, int s) {
                  return x * 0.2 + s * 0.1;
                }};
  const auto read = [&](const std::string& profile, const PictureChoice& choice = {}) {
    return read_signal(tiff_of(with_profile(kind, profile)), choice);
  };
  ASSERT_OK_AND_ASSIGN(const Image linear, read(bytes_of(adobe_profile(cmsBuildGamma(nullptr, 1)))));
  EXPECT_EQ(linear.light, PictureLight::kScene);
  EXPECT_LE(worst_of(linear, kind), 1e-6);
  ASSERT_TRUE(linear.chromaticities.has_value());
  EXPECT_NEAR(linear.chromaticities->at(2), 0.21, 1e-3);

  const std::string gamma = bytes_of(adobe_profile(cmsBuildGamma(nullptr, 2)));
  ASSERT_OK_AND_ASSIGN(const Image encoded, read(gamma));
  EXPECT_EQ(encoded.light, PictureLight::kSdr);
  EXPECT_EQ(encoded.signal, "floats of 32 bits, gamma 2, from ICC");
  EXPECT_NEAR(component(encoded, 20, 3, 1), std::pow(kind.value(20, 3, 1), 2), 1e-4);
  ASSERT_OK_AND_ASSIGN(const Image overruled, read(gamma, {.transfer = SignalTransfer::kLinear}));
  EXPECT_EQ(overruled.light, PictureLight::kScene);
  EXPECT_LE(worst_of(overruled, kind), 1e-6);

  ASSERT_OK_AND_ASSIGN(const Image kept, read(gamma, {.keeps_signal = true}));
  EXPECT_LE(worst_of(kept, kind), 1e-6);

  const cmsUInt16Number steps[] = {0, 9000, 12000, 65535};
  ASSERT_OK_AND_ASSIGN(const Image own,
                       read(bytes_of(adobe_profile(cmsBuildTabulatedToneCurve16(nullptr, 4, steps)))));
  EXPECT_LE(worst_of(own, kind), 1e-6);
  EXPECT_TRUE(notes(own, "its ICC profile has curves or tables of its own, which are not used of floats"));
  ASSERT_OK_AND_ASSIGN(const Image damaged, read("no profile"));
  EXPECT_TRUE(notes(damaged, "its ICC profile cannot be used: "));
}

TEST(TiffReader, TheTagsOfPrimariesCount) {
  for (const uint16_t format : {SAMPLEFORMAT_UINT, SAMPLEFORMAT_IEEEFP}) {
    TiffKind kind{.bits = 16, .format = format, .value = [](uint32_t, uint32_t, int) { return 1; }};
    kind.more = [](TIFF* tiff) {
      const float primaries[] = {0.708f, 0.292f, 0.170f, 0.797f, 0.131f, 0.046f},
                  white[] = {0.3127f, 0.3290f};
      TIFFSetField(tiff, TIFFTAG_PRIMARYCHROMATICITIES, primaries);
      TIFFSetField(tiff, TIFFTAG_WHITEPOINT, white);
    };
    ASSERT_OK_AND_ASSIGN(const Image image, read_signal(tiff_of(kind)));
    ASSERT_TRUE(image.chromaticities.has_value());
    EXPECT_NEAR(image.chromaticities->at(0), 0.708, 1e-6);
    EXPECT_NEAR(image.chromaticities->at(7), 0.329, 1e-6);
  }
}

TEST(TiffReader, TheFirstPictureIsShownThatIsNoPreview) {
  const auto preview = [](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, FILETYPE_REDUCEDIMAGE); };
  const TiffKind small{.width = 4, .height = 3, .more = preview}, large{}, other{.width = 9};
  ASSERT_OK_AND_ASSIGN(const Image one, read_signal(tiff_of({small, large})));
  EXPECT_EQ(one.width, large.width);
  EXPECT_LE(worst_of(one, large), 1e-5);
  EXPECT_TRUE(one.notes.empty());
  ASSERT_OK_AND_ASSIGN(const Image first, read_signal(tiff_of({large, small, other})));
  EXPECT_EQ(first.width, large.width);
  EXPECT_TRUE(notes(first, "the first of its pictures is shown"));
  ASSERT_OK_AND_ASSIGN(const Image alone, read_signal(tiff_of(small)));
  EXPECT_EQ(alone.width, small.width);

  TiffKind raw = small;
  raw.more = [](TIFF* tiff) {
    const uint64_t places[] = {0};
    TIFFSetField(tiff, TIFFTAG_SUBFILETYPE, FILETYPE_REDUCEDIMAGE);
    TIFFSetField(tiff, TIFFTAG_SUBIFD, 1, places);
  };
  EXPECT_REFUSED(kUnimplemented, "file: it shows only a preview, as a camera's raw file does; develop it",
                 read_signal(tiff_of({raw, small})));
  std::string canon = tiff_of(large);
  canon.replace(8, 2, "CR");
  EXPECT_REFUSED(kUnimplemented, "as a camera's raw file does", read_signal(canon));
}

TEST(TiffReader, OtherKindsAreRefusedByName) {
  const auto refused = [](const TiffKind& kind, const char* words) {
    EXPECT_REFUSED(kUnimplemented, words, read_signal(tiff_of(kind)));
  };
  refused({.photometric = PHOTOMETRIC_CIELAB}, "file: its colours are L*a*b* (photometric interpretation 8)");
  refused({.samples = 1, .photometric = PHOTOMETRIC_CFA}, "its colours are a camera's raw samples");
  refused({.bits = 32}, "its samples are unsigned integers of 32 bits");
  refused({.bits = 16, .format = SAMPLEFORMAT_INT}, "its samples are signed integers of 16 bits");
  refused({.bits = 32, .format = SAMPLEFORMAT_COMPLEXINT}, "its samples are complex numbers of 32 bits");
  refused({.bits = 32, .samples = 4, .format = SAMPLEFORMAT_IEEEFP, .photometric = PHOTOMETRIC_SEPARATED},
          "its samples are floats of 32 bits (photometric interpretation 5)");
  TiffKind inks{.samples = 5, .photometric = PHOTOMETRIC_SEPARATED};
  inks.more = [](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_INKSET, INKSET_MULTIINK); };
  refused(inks, "its colours are inks other than CMYK");

  for (const auto& [compression, words] :
       {std::pair{34712, "file: its compression is number 34712, which is not read; save it with Deflate"},
        std::pair{COMPRESSION_JBIG, "its compression is ISO JBIG"}, std::pair{COMPRESSION_LZMA, "is LZMA"},
        std::pair{COMPRESSION_OJPEG, "is Old-style JPEG"}}) {
    std::string file = tiff_of(TiffKind{.compression = COMPRESSION_LZW, .mode = "wl"});
    const std::string entry("\x03\x01\x03\x00\x01\x00\x00\x00\x05\x00", 10);  // Compression, SHORT, 1, LZW
    const size_t at = file.find(entry);
    ASSERT_NE(at, std::string::npos);
    file[at + 8] = static_cast<char>(compression & 255);
    file[at + 9] = static_cast<char>(compression >> 8);
    EXPECT_REFUSED(kUnimplemented, words, read_signal(file));
  }
  EXPECT_REFUSED(kInvalidArgument, "only OpenEXR files have parts",
                 read_image_bytes("file", tiff_of(TiffKind{}), {}, {.part = "1"}));
}

TEST(TiffReader, MemoryIsTakenForNoMoreThanTheLimits) {
  const std::string file = tiff_of(TiffKind{.width = 64, .height = 64});
  EXPECT_REFUSED(kResourceExhausted, "file: the image is 64x64 pixels; the limit is 63 on a side",
                 read_image_bytes("file", file, {.max_dimension = 63}));
  EXPECT_REFUSED(kResourceExhausted, "--max-pixels allows 4095",
                 read_image_bytes("file", file, {.max_pixels = 4095}));

  const TiffKind huge{.width = 20, .height = 20, .compression = COMPRESSION_LZW, .tile = 1024};
  EXPECT_REFUSED(kResourceExhausted,
                 "file: its samples are 1 tiles of 3145728 bytes; the limits are 1048576 bytes for one",
                 read_image_bytes("file", tiff_of(huge), {.max_chunk_bytes = 1 << 20}));
  // A narrow picture of wide tiles: each is small, and all of them are large.
  TiffKind narrow{.width = 1, .height = 2048, .compression = COMPRESSION_LZW, .tile = 512};
  narrow.more = [](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_TILELENGTH, 512); };
  EXPECT_REFUSED(
      kResourceExhausted, "save it with smaller tiles",
      read_image_bytes("file", tiff_of(narrow), {.max_bytes = 1 << 20, .max_chunk_bytes = 1 << 20}));
  TiffKind many{.samples = 65, .extras = std::vector<uint16_t>(62, EXTRASAMPLE_UNSPECIFIED)};
  EXPECT_REFUSED(kInvalidArgument, "file: it has 65 samples a pixel; its colours need 3, and 64 is the limit",
                 read_signal(tiff_of(many)));
}

TEST(TiffReader, WhatIsThereOfADamagedFileCanBeRead) {
  for (const uint32_t tile : {0, 16}) {
    for (const uint16_t planes : {PLANARCONFIG_CONTIG, PLANARCONFIG_SEPARATE}) {
      SCOPED_TRACE(absl::StrCat("tile ", tile, ", planes ", planes));
      TiffKind kind{.width = 32,
                    .height = 32,
                    .planes = planes,
                    .compression = COMPRESSION_ADOBE_DEFLATE,
                    .tile = tile,
                    .strip_rows = 8};
      std::string file = tiff_of(kind);
      // The first strip or tile begins behind the header.
      for (size_t i = 8; i < 24; ++i) file[i] = 'x';
      EXPECT_REFUSED(kInvalidArgument, "file: damaged TIFF file: ", read_signal(file));
      EXPECT_REFUSED(kInvalidArgument, "; --incomplete fill renders what is there", read_signal(file));
      ASSERT_OK_AND_ASSIGN(const Image image, read_signal(file, {.fills_gaps = true}));
      EXPECT_EQ(image.missing_pixels, tile == 0 ? 8u * 32 : 16u * 16);
      EXPECT_TRUE(image.has_alpha);
      for (int c = 0; c < 4; ++c) EXPECT_EQ(component(image, 2, 3, c), 0);
      EXPECT_EQ(component(image, 20, 20, 3), 1);
      EXPECT_NEAR(component(image, 20, 20, 1), decoded_srgb(usual_value(kind, 20, 20, 1) / 255), 1e-6);
    }
  }
}

TEST(TiffReader, RowsBeforeTheDamageOfAStripAreThere) {
  // Noise, so that what comes first in the strip is what comes first in the picture.
  TiffKind kind{.width = 64, .height = 400, .compression = COMPRESSION_LZW, .strip_rows = 400};
  std::mt19937 random(7);
  std::vector<uint8_t> noise(size_t{3} * 64 * 400);
  for (uint8_t& code : noise) code = static_cast<uint8_t>(random() % 16);
  kind.value = [&](uint32_t x, uint32_t y, int s) { return noise[(y * 64 + x) * 3 + s]; };
  std::string file = tiff_of(kind);
  ASSERT_GT(file.size(), noise.size() / 2);
  std::fill_n(file.begin() + 20000, 1000, '\xff');
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(file, {.fills_gaps = true}));
  EXPECT_GT(image.missing_pixels, 64u * 100);
  EXPECT_LT(image.missing_pixels, 64u * 300);
  EXPECT_EQ(component(image, 63, 100, 3), 1);
  EXPECT_NEAR(component(image, 63, 100, 2), decoded_srgb(usual_value(kind, 63, 100, 2) / 255), 1e-6);
  EXPECT_EQ(component(image, 63, 399, 3), 0);
}

TEST(TiffReader, ATruncatedFileIsRefused) {
  const std::string file = tiff_of(TiffKind{});
  for (size_t size = 4; size < file.size(); size += 7) {
    const absl::Status status = read_signal(file.substr(0, size)).status();
    EXPECT_FALSE(status.ok()) << size << " of " << file.size();
    EXPECT_TRUE(absl::StartsWith(status.message(), "file: ")) << status;
  }
}

TEST(TiffReader, AFileIsDescribed) {
  const TemporaryFile file(tiff_of(TiffKind{.bits = 16}));
  ASSERT_OK_AND_ASSIGN(const FileFacts facts, describe_image(file.path()));
  EXPECT_EQ(facts.kind, "TIFF");
  ASSERT_EQ(facts.parts.size(), 1u);
  EXPECT_EQ(facts.parts[0].storage, "16 bits, sRGB, assumed");
  EXPECT_OK(facts.renderable);
}

TEST(TiffReader, WhatCandelaWritesIsReadBack) {
  const TemporaryFolder folder;
  for (const ImageFormat format : {ImageFormat::kRgba8, ImageFormat::kRgba16}) {
    Image image = *make_image(17, 9, format);
    image.has_alpha = true;
    image.pixel_aspect = 2;
    for (size_t i = 0; i < image.bytes(); ++i)
      image.pixels.data()[i] = static_cast<std::byte>(i * 31 + i / 97);
    ASSERT_OK(write_image(folder.path("out.tif"), image));
    ASSERT_OK_AND_ASSIGN(const Image read, read_image(folder.path("out.tif")));
    const double top = format == ImageFormat::kRgba8 ? 255 : 65535;
    EXPECT_NEAR(read.pixel_aspect, 2, 1e-6);
    EXPECT_EQ(read.signal,
              format == ImageFormat::kRgba8 ? "8 bits, sRGB, from ICC" : "16 bits, sRGB, from ICC");
    for (uint32_t x = 0; x < image.width; ++x) {
      const double alpha = component(image, x, 8, 3) / top;
      EXPECT_NEAR(component(read, x, 8, 3), alpha, 1e-6);
      EXPECT_NEAR(component(read, x, 8, 0), alpha * decoded_srgb(component(image, x, 8, 0) / top), 1e-6);
    }
    ASSERT_OK_AND_ASSIGN(const Image codes, read_image(folder.path("out.tif"), {}, {.keeps_signal = true}));
    EXPECT_NEAR(component(codes, 3, 2, 1), component(read, 3, 2, 3) * component(image, 3, 2, 1) / top, 1e-6);
  }
}

}  // namespace
}  // namespace candela
