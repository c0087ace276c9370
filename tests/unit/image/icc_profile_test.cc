// Pictures with ICC profiles, beside what lcms2 itself makes of their codes.
// jpeglib.h needs FILE and size_t to be declared before it.
// clang-format off
#include <cstdio>
#include <jpeglib.h>
// clang-format on

#include <avif/avif.h>
#include <gtest/gtest.h>
#include <lcms2.h>
#include <tiffio.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/image/color.h"
#include "client/image/image.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

// ---- Profiles ----

constexpr cmsCIExyY kD65{0.3127, 0.3290, 1}, kD50{0.3457, 0.3585, 1};

std::string saved(cmsHPROFILE profile) {
  cmsUInt32Number size = 0;
  EXPECT_TRUE(cmsSaveProfileToMem(profile, nullptr, &size));
  std::string bytes(size, '\0');
  EXPECT_TRUE(cmsSaveProfileToMem(profile, bytes.data(), &size));
  cmsCloseProfile(profile);
  return bytes;
}

using Function = std::function<double(double)>;

cmsToneCurve* table_of(size_t count, const Function& light) {
  std::vector<cmsUInt16Number> values(count);
  for (size_t i = 0; i < count; ++i) {
    const double v = static_cast<double>(i) / static_cast<double>(count - 1);
    values[i] = static_cast<cmsUInt16Number>(std::lround(65535 * light(v)));
  }
  return cmsBuildTabulatedToneCurve16(nullptr, static_cast<cmsUInt32Number>(count), values.data());
}
Function power_of(double gamma) {
  return [gamma](double v) { return std::pow(v, gamma); };
}
double srgb_light(double v) { return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4); }
cmsToneCurve* srgb_curve() {
  const cmsFloat64Number numbers[] = {2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045};
  return cmsBuildParametricToneCurve(nullptr, 4, numbers);
}

cmsHPROFILE opened_matrix(const std::array<double, 6>& xy, const cmsCIExyY& white,
                          std::vector<cmsToneCurve*> curves, double version = 4.3) {
  const cmsCIExyYTRIPLE primaries = {{xy[0], xy[1], 1}, {xy[2], xy[3], 1}, {xy[4], xy[5], 1}};
  while (curves.size() < 3) curves.push_back(cmsDupToneCurve(curves[0]));
  cmsHPROFILE profile = cmsCreateRGBProfile(&white, &primaries, curves.data());
  for (cmsToneCurve* curve : curves) cmsFreeToneCurve(curve);
  cmsSetProfileVersion(profile, version);
  return profile;
}
std::string matrix(const std::array<double, 6>& xy, const cmsCIExyY& white, std::vector<cmsToneCurve*> curves,
                   double version = 4.3) {
  return saved(opened_matrix(xy, white, std::move(curves), version));
}
constexpr std::array<double, 6> kXy709{0.64, 0.33, 0.30, 0.60, 0.15, 0.06};
constexpr std::array<double, 6> kXyP3{0.68, 0.32, 0.265, 0.69, 0.15, 0.06};
constexpr std::array<double, 6> kXy2020{0.708, 0.292, 0.170, 0.797, 0.131, 0.046};
constexpr std::array<double, 6> kXyAdobe{0.64, 0.33, 0.21, 0.71, 0.15, 0.06};

// A profile whose table of so many points leads to the Lab of `rgb`, 0 .. 1 of P3 with a gamma of 2.2.
struct Sampler {
  cmsHTRANSFORM to_lab;
  std::function<std::array<double, 3>(const std::array<double, 4>&)> rgb;
  size_t channels;
};
cmsInt32Number sample(const cmsUInt16Number in[], cmsUInt16Number out[], void* cargo) {
  const auto& sampler = *static_cast<const Sampler*>(cargo);
  std::array<double, 4> values{};
  for (size_t i = 0; i < sampler.channels; ++i) values[i] = in[i] / 65535.0;
  const std::array<double, 3> rgb = sampler.rgb(values);
  cmsDoTransform(sampler.to_lab, rgb.data(), out, 1);
  return TRUE;
}
std::string table(cmsColorSpaceSignature space, uint32_t channels, uint32_t points,
                  std::function<std::array<double, 3>(const std::array<double, 4>&)> rgb) {
  cmsHPROFILE p3 = opened_matrix(kXyP3, kD65, {cmsBuildGamma(nullptr, 2.2)});
  cmsHPROFILE lab = cmsCreateLab2Profile(nullptr);
  Sampler sampler{cmsCreateTransform(p3, TYPE_RGB_DBL, lab, TYPE_LabV2_16, INTENT_PERCEPTUAL, 0),
                  std::move(rgb), channels};
  cmsCloseProfile(p3);
  cmsCloseProfile(lab);
  cmsStage* const grid = cmsStageAllocCLut16bit(nullptr, points, channels, 3, nullptr);
  EXPECT_TRUE(cmsStageSampleCLut16bit(grid, sample, &sampler, 0));
  cmsDeleteTransform(sampler.to_lab);
  cmsPipeline* const pipeline = cmsPipelineAlloc(nullptr, channels, 3);
  EXPECT_TRUE(cmsPipelineInsertStage(pipeline, cmsAT_END, grid));
  cmsHPROFILE profile = cmsCreateProfilePlaceholder(nullptr);
  cmsSetProfileVersion(profile, 2.1);
  cmsSetDeviceClass(profile, channels == 4 ? cmsSigOutputClass : cmsSigDisplayClass);
  cmsSetColorSpace(profile, space);
  cmsSetPCS(profile, cmsSigLabData);
  EXPECT_TRUE(cmsWriteTag(profile, cmsSigAToB0Tag, pipeline));
  cmsPipelineFree(pipeline);
  return saved(profile);
}

std::string grey(double gamma) {
  cmsToneCurve* const curve = cmsBuildGamma(nullptr, gamma);
  cmsHPROFILE profile = cmsCreateGrayProfile(&kD50, curve);
  cmsFreeToneCurve(curve);
  return saved(profile);
}

std::string rgb_table() {
  return table(cmsSigRgbData, 3, 17, [](const std::array<double, 4>& v) {
    return std::array<double, 3>{v[0], 0.9 * v[1] + 0.1 * v[2], std::pow(v[2], 1.2)};
  });
}
std::string cmyk_table() {
  return table(cmsSigCmykData, 4, 9, [](const std::array<double, 4>& v) {
    const double k = 1 - 0.9 * v[3];
    return std::array<double, 3>{(1 - v[0]) * k, (1 - 0.8 * v[1]) * k, (1 - v[2]) * k};
  });
}

struct NamedProfile {
  const char* name;
  std::string bytes;
  const char* signal;  // what a picture of 8 bits says of it
};
std::vector<NamedProfile> rgb_profiles() {
  const cmsFloat64Number romm[] = {1.8, 1, 0, 1 / 16.0, 0.03125};
  const auto lifted = [](double v) { return 0.01 + 0.99 * std::pow(v, 2.2); };
  return {
      {"sRGB, v2", matrix(kXy709, kD65, {table_of(1024, srgb_light)}, 2.1), "sRGB"},
      {"sRGB, v4", matrix(kXy709, kD65, {srgb_curve()}), "sRGB"},
      {"Display P3", matrix(kXyP3, kD65, {srgb_curve()}), "sRGB"},
      {"Adobe RGB", matrix(kXyAdobe, kD65, {cmsBuildGamma(nullptr, 563 / 256.0)}, 2.1), "gamma 2.2"},
      {"ProPhoto",
       matrix({0.734699, 0.265301, 0.159597, 0.840403, 0.036598, 0.000105}, kD50,
              {cmsBuildParametricToneCurve(nullptr, 4, romm)}),
       "the profile's curves"},
      {"linear Rec.709", matrix(kXy709, kD65, {cmsBuildGamma(nullptr, 1)}), "linear"},
      {"linear Rec.2020", matrix(kXy2020, kD65, {cmsBuildGamma(nullptr, 1)}, 2.1), "linear"},
      {"DCI-P3", matrix(kXyP3, {0.314, 0.351, 1}, {cmsBuildGamma(nullptr, 2.6)}), "gamma 2.6"},
      {"a monitor's",
       matrix({0.651, 0.332, 0.312, 0.622, 0.148, 0.053}, {0.3095, 0.3260, 1},
              {table_of(256, power_of(2.1)), table_of(256, power_of(2.25)), table_of(4096, power_of(2.4))}),
       "the profile's curves"},
      {"a monitor's that glows", matrix(kXy709, kD65, {table_of(256, lifted)}, 2.1), "the profile's table"},
      {"a table", rgb_table(), "the profile's table"}};
}

// ---- Pictures: patches of 8x8 pixels in a row ----

using Patch = std::array<uint8_t, 4>;

std::vector<Patch> patches() {
  std::vector<Patch> all;
  for (const int v : {0, 1, 2, 5, 10, 32, 64, 128, 200, 254, 255}) {
    const auto code = static_cast<uint8_t>(v);
    all.push_back({code, code, code, 0});
    all.push_back({code, 0, 0, 0});
    all.push_back({0, code, 0, 0});
    all.push_back({0, 0, code, 0});
    all.push_back({code, static_cast<uint8_t>(255 - v), 128, 20});
    all.push_back({5, code, static_cast<uint8_t>(v / 2), 200});
  }
  return all;
}

std::string jpeg(const std::vector<Patch>& codes, int components, const std::string& profile) {
  jpeg_compress_struct codec{};
  jpeg_error_mgr errors{};
  codec.err = jpeg_std_error(&errors);
  jpeg_create_compress(&codec);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&codec, &bytes, &size);
  codec.image_width = static_cast<JDIMENSION>(8 * codes.size());
  codec.image_height = 8;
  codec.input_components = components;
  codec.in_color_space = components == 1 ? JCS_GRAYSCALE : components == 3 ? JCS_RGB : JCS_CMYK;
  jpeg_set_defaults(&codec);
  jpeg_set_colorspace(&codec, codec.in_color_space);  // so that a patch keeps its codes
  jpeg_set_quality(&codec, 100, TRUE);
  jpeg_start_compress(&codec, TRUE);
  if (!profile.empty()) {
    jpeg_write_icc_profile(&codec, reinterpret_cast<const JOCTET*>(profile.data()),
                           static_cast<unsigned>(profile.size()));
  }
  std::vector<uint8_t> row;
  for (const Patch& patch : codes) {
    for (int x = 0; x < 8; ++x) row.insert(row.end(), patch.begin(), patch.begin() + components);
  }
  JSAMPROW rows = row.data();
  for (int y = 0; y < 8; ++y) jpeg_write_scanlines(&codec, &rows, 1);
  jpeg_finish_compress(&codec);
  std::string file(reinterpret_cast<const char*>(bytes), size);
  std::free(bytes);
  jpeg_destroy_compress(&codec);
  return file;
}

std::string iccp(const std::string& profile) {
  std::string packed(compressBound(profile.size()), '\0');
  uLongf size = packed.size();
  EXPECT_EQ(compress(reinterpret_cast<Bytef*>(packed.data()), &size,
                     reinterpret_cast<const Bytef*>(profile.data()), profile.size()),
            Z_OK);
  return chunk("iCCP", std::string("any\0\0", 5) + packed.substr(0, size));
}
std::string png(const std::vector<Patch>& codes, int components, int bits, const std::string& chunks) {
  std::string row;
  for (const Patch& patch : codes) {
    for (int i = 0; i < 8 * components; ++i) {
      row.append(bits / 8, static_cast<char>(patch[static_cast<size_t>(i % components)]));
    }
  }
  return png_of(static_cast<uint32_t>(8 * codes.size()), bits, components == 1 ? 0 : 2, row, chunks);
}

std::string avif(
    const std::vector<Patch>& codes, int components, const std::string& profile,
    const std::function<void(avifImage&)>& change = [](avifImage&) {}) {
  avifImage* const image =
      avifImageCreate(static_cast<int>(8 * codes.size()), 8, 8,
                      components == 1 ? AVIF_PIXEL_FORMAT_YUV400 : AVIF_PIXEL_FORMAT_YUV444);
  image->yuvRange = AVIF_RANGE_FULL;
  if (components == 3) image->matrixCoefficients = AVIF_MATRIX_COEFFICIENTS_IDENTITY;
  if (!profile.empty()) {
    avifImageSetProfileICC(image, reinterpret_cast<const uint8_t*>(profile.data()), profile.size());
  }
  change(*image);
  avifImageAllocatePlanes(image, AVIF_PLANES_YUV);
  constexpr int kPlaneOf[] = {AVIF_CHAN_V, AVIF_CHAN_Y, AVIF_CHAN_U};  // of R, G and B
  for (int c = 0; c < components; ++c) {
    const int plane = components == 1 ? int{AVIF_CHAN_Y} : kPlaneOf[c];
    for (uint32_t y = 0; y < 8; ++y) {
      for (uint32_t x = 0; x < image->width; ++x) {
        image->yuvPlanes[plane][y * image->yuvRowBytes[plane] + x] = codes[x / 8][static_cast<size_t>(c)];
      }
    }
  }
  avifEncoder* const encoder = avifEncoderCreate();
  encoder->minQuantizer = encoder->maxQuantizer = AVIF_QUANTIZER_LOSSLESS;
  encoder->speed = 9;
  avifRWData data = AVIF_DATA_EMPTY;
  EXPECT_EQ(avifEncoderWrite(encoder, image, &data), AVIF_RESULT_OK);
  std::string bytes(reinterpret_cast<const char*>(data.data), data.size);
  avifRWDataFree(&data);
  avifEncoderDestroy(encoder);
  avifImageDestroy(image);
  return bytes;
}

std::string tiff(const std::vector<Patch>& codes, int components, int bits, const std::string& profile) {
  const TemporaryFolder folder;
  const std::string path = folder.path("made.tif");
  TIFF* const file = TIFFOpen(path.c_str(), "w");
  TIFFSetField(file, TIFFTAG_IMAGEWIDTH, static_cast<uint32_t>(8 * codes.size()));
  TIFFSetField(file, TIFFTAG_IMAGELENGTH, 1);
  TIFFSetField(file, TIFFTAG_BITSPERSAMPLE, bits);
  TIFFSetField(file, TIFFTAG_SAMPLESPERPIXEL, components);
  TIFFSetField(file, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(file, TIFFTAG_PHOTOMETRIC,
               components == 1   ? PHOTOMETRIC_MINISBLACK
               : components == 3 ? PHOTOMETRIC_RGB
                                 : PHOTOMETRIC_SEPARATED);
  TIFFSetField(file, TIFFTAG_ICCPROFILE, static_cast<uint32_t>(profile.size()), profile.data());
  std::string row;
  for (const Patch& patch : codes) {
    for (int i = 0; i < 8 * components; ++i) {
      row.append(static_cast<size_t>(bits / 8),
                 static_cast<char>(patch[static_cast<size_t>(i % components)]));
    }
  }
  EXPECT_EQ(TIFFWriteScanline(file, row.data(), 0, 0), 1);
  TIFFClose(file);
  return read_file(path);
}

// ---- Comparison ----

// The codes of sRGB that lcms2 makes of the patches.
std::vector<std::array<uint8_t, 3>> wanted(const std::string& profile, const std::vector<Patch>& codes) {
  cmsHPROFILE from = cmsOpenProfileFromMem(profile.data(), static_cast<cmsUInt32Number>(profile.size()));
  cmsHPROFILE to = cmsCreate_sRGBProfile();
  const cmsColorSpaceSignature space = cmsGetColorSpace(from);
  const uint32_t channels = space == cmsSigGrayData ? 1 : space == cmsSigRgbData ? 3 : 4;
  const uint32_t format = COLORSPACE_SH(static_cast<uint32_t>(_cmsLCMScolorSpace(space))) |
                          CHANNELS_SH(channels) | EXTRA_SH(4 - channels) | BYTES_SH(1);
  cmsHTRANSFORM transform =
      cmsCreateTransform(from, format, to, TYPE_RGB_8, INTENT_PERCEPTUAL, cmsFLAGS_NOOPTIMIZE);
  std::vector<std::array<uint8_t, 3>> rgb(codes.size());
  cmsDoTransform(transform, codes.data(), rgb.data(), static_cast<cmsUInt32Number>(codes.size()));
  cmsDeleteTransform(transform);
  cmsCloseProfile(to);
  cmsCloseProfile(from);
  return rgb;
}

// Each patch of the picture in Rec.709, as a code of sRGB that is not rounded.
std::vector<std::array<double, 3>> shown(const Image& image) {
  const std::array<float, 8> xy = image.chromaticities.value_or(kRec709.xy);
  std::array<double, 6> primaries{};
  std::copy_n(xy.begin(), 6, primaries.begin());
  cmsHPROFILE from = opened_matrix(primaries, {xy[6], xy[7], 1}, {cmsBuildGamma(nullptr, 1)});
  cmsHPROFILE to = opened_matrix(kXy709, kD65, {cmsBuildGamma(nullptr, 1)});
  cmsHTRANSFORM transform = cmsCreateTransform(from, TYPE_RGB_FLT, to, TYPE_RGB_FLT, INTENT_PERCEPTUAL, 0);
  std::vector<std::array<double, 3>> all;
  for (uint32_t x = 4; x < image.width; x += 8) {
    std::array<float, 3> light{};
    for (int c = 0; c < 3; ++c) light[static_cast<size_t>(c)] = component(image, x, 0, c);
    cmsDoTransform(transform, light.data(), light.data(), 1);
    std::array<double, 3>& codes = all.emplace_back();
    for (size_t c = 0; c < 3; ++c) {
      const double v = std::clamp(light[c], 0.0f, 1.0f);
      codes[c] = 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1 / 2.4) - 0.055);
    }
  }
  cmsDeleteTransform(transform);
  cmsCloseProfile(from);
  cmsCloseProfile(to);
  return all;
}

// Reads the file, and compares its patches with lcms2's. Returns the largest difference in codes.
double difference(const std::string& file, const std::string& profile, const std::vector<Patch>& codes,
                  const std::string& what) {
  const absl::StatusOr<Image> image = read_signal(file);
  EXPECT_OK(image.status()) << what;
  if (!image.ok()) return 0;
  EXPECT_TRUE(image->notes.empty()) << what << ": " << image->notes.front();
  const auto seen = shown(*image);
  const auto expected = wanted(profile, codes);
  double most = 0;
  for (size_t i = 0; i < codes.size(); ++i) {
    for (size_t c = 0; c < 3; ++c) {
      const double d = std::fabs(seen[i][c] - expected[i][c]);
      most = std::max(most, d);
      EXPECT_LE(d, 1) << what << ": " << int{codes[i][0]} << " " << int{codes[i][1]} << " "
                      << int{codes[i][2]} << " " << int{codes[i][3]} << ", channel " << c << ": "
                      << seen[i][c];
    }
  }
  return most;
}

TEST(IccProfile, APictureIsWhatLcmsMakesOfIt) {
  const std::vector<Patch> codes = patches();
  for (const NamedProfile& profile : rgb_profiles()) {
    const auto same = [&](const char* kind, const std::string& file) {
      const double most = difference(file, profile.bytes, codes, absl::StrCat(profile.name, ", ", kind));
      printf("%s, %s: at most %.2f codes\n", profile.name, kind, most);
    };
    const std::string file = png(codes, 3, 8, iccp(profile.bytes));
    same("PNG of 8 bits", file);
    same("PNG of 16 bits", png(codes, 3, 16, iccp(profile.bytes)));
    same("JPEG", jpeg(codes, 3, profile.bytes));
    same("AVIF", avif(codes, 3, profile.bytes));
    same("TIFF of 8 bits", tiff(codes, 3, 8, profile.bytes));
    same("TIFF of 16 bits", tiff(codes, 3, 16, profile.bytes));
    EXPECT_EQ(read_signal(file)->signal, absl::StrCat("8 bits, ", profile.signal, ", from iCCP"));
    EXPECT_EQ(read_signal(file)->light, PictureLight::kSdr);
    EXPECT_TRUE(read_signal(file)->names_primaries);
  }
}

TEST(IccProfile, GreyAndCmykAreRead) {
  const std::vector<Patch> codes = patches();
  const std::string grey_profile = grey(2.2);
  difference(png(codes, 1, 8, iccp(grey_profile)), grey_profile, codes, "grey PNG");
  difference(jpeg(codes, 1, grey_profile), grey_profile, codes, "grey JPEG");
  difference(avif(codes, 1, grey_profile), grey_profile, codes, "grey AVIF");
  difference(tiff(codes, 1, 16, grey_profile), grey_profile, codes, "grey TIFF");
  // A grey picture may have a profile of R, G and B.
  std::vector<Patch> greys = codes;
  for (Patch& patch : greys) patch = {patch[0], patch[0], patch[0], 0};
  for (const std::string& profile : {matrix(kXyAdobe, kD65, {cmsBuildGamma(nullptr, 1.8)}), rgb_table()}) {
    difference(png(greys, 1, 8, iccp(profile)), profile, greys, "grey PNG of RGB");
    difference(jpeg(greys, 1, profile), profile, greys, "grey JPEG of RGB");
    difference(tiff(greys, 1, 8, profile), profile, greys, "grey TIFF of RGB");
  }
  // Adobe's marker, which libjpeg writes, says that 255 is no ink.
  std::vector<Patch> inks = codes;
  for (Patch& patch : inks) {
    for (uint8_t& code : patch) code = static_cast<uint8_t>(255 - code);
  }
  const std::string cmyk_profile = cmyk_table();
  difference(jpeg(inks, 4, cmyk_profile), cmyk_profile, codes, "CMYK JPEG");
  difference(tiff(codes, 4, 8, cmyk_profile), cmyk_profile, codes, "CMYK TIFF of 8 bits");
  difference(tiff(codes, 4, 16, cmyk_profile), cmyk_profile, codes, "CMYK TIFF of 16 bits");
}

TEST(IccProfile, InksWithoutAProfileAreIdeal) {
  ASSERT_OK_AND_ASSIGN(const Image image, read_signal(jpeg({{255 - 51, 255, 0, 255 - 128}}, 4, "")));
  const double half = 1 - 128 / 255.0;
  EXPECT_NEAR(component(image, 0, 0, 0), srgb_light(0.8 * half), 1e-5);
  EXPECT_NEAR(component(image, 0, 0, 1), srgb_light(half), 1e-5);
  EXPECT_EQ(component(image, 0, 0, 2), 0);
  EXPECT_EQ(component(image, 0, 0, 3), 1);
  EXPECT_TRUE(says(image.notes.front(), "its inks are taken as ideal"));
}

// What a picture says of its signal.
std::string signal_of(const std::string& file, const PictureChoice& choice = {}) {
  const absl::StatusOr<Image> image = read_signal(file, choice);
  EXPECT_OK(image.status());
  return image.ok() ? image->signal : "";
}
float red_of(const std::string& file, const PictureChoice& choice = {}) {
  const absl::StatusOr<Image> image = read_signal(file, choice);
  EXPECT_OK(image.status());
  return image.ok() ? image->chromaticities.value_or(kRec709.xy)[0] : 0;
}

const std::vector<Patch> kGreyPatch = {{128, 128, 128, 128}};

TEST(IccProfile, InAnAvifItCountsBeforeCodePointsThatAreNotHdr) {
  const std::string adobe = matrix(kXyAdobe, kD65, {cmsBuildGamma(nullptr, 2.2)});
  const auto file = [&](const std::string& profile, int primaries, int transfer) {
    return avif(kGreyPatch, 3, profile, [&](avifImage& image) {
      image.colorPrimaries = static_cast<avifColorPrimaries>(primaries);
      image.transferCharacteristics = static_cast<avifTransferCharacteristics>(transfer);
    });
  };
  for (const auto& [primaries, transfer] : {std::pair(2, 2), {1, 13}, {9, 14}, {9, 2}, {99, 99}}) {
    EXPECT_EQ(signal_of(file(adobe, primaries, transfer)), "8 bits, gamma 2.2, from ICC");
    EXPECT_EQ((*read_signal(file(adobe, primaries, transfer))->chromaticities)[2], 0.21f);
  }
  ASSERT_OK_AND_ASSIGN(const Image pq, read_signal(file(adobe, 9, 16)));
  EXPECT_EQ(pq.signal, "8 bits, PQ, from nclx");
  EXPECT_EQ((*pq.chromaticities)[0], 0.708f);
  EXPECT_EQ(pq.notes.front(), "the file's ICC profile is not used: its code points count");
  EXPECT_EQ(signal_of(file(adobe, 2, 18)), "8 bits, HLG, from nclx");
  EXPECT_EQ((*read_signal(file(adobe, 2, 18))->chromaticities)[2], 0.21f);
  EXPECT_EQ(red_of(file(rgb_table(), 2, 16)), 0.64f);  // it names no primaries
  EXPECT_EQ(signal_of(file("damaged", 12, 13)), "8 bits, sRGB, from nclx");
  EXPECT_EQ(read_signal(file("damaged", 12, 13))->notes.front(),
            "its ICC profile cannot be used: it is damaged");
}

TEST(IccProfile, InAPngItCountsBehindCicp) {
  const std::string p3 = iccp(matrix(kXyP3, kD65, {cmsBuildGamma(nullptr, 2.2)}));
  const auto file = [&](const std::string& profile, int primaries, int transfer) {
    return png(kGreyPatch, 3, 8, cicp(primaries, transfer) + profile);
  };
  EXPECT_EQ(signal_of(file(p3, 2, 2)), "8 bits, gamma 2.2, from iCCP");
  EXPECT_EQ(signal_of(file(p3, 9, 16)), "8 bits, PQ, from cICP");
  EXPECT_EQ(red_of(file(p3, 9, 16)), 0.708f);
  EXPECT_EQ(signal_of(file(p3, 2, 8)), "8 bits, linear, from cICP");
  EXPECT_EQ(red_of(file(p3, 2, 8)), 0.68f);
  EXPECT_EQ(signal_of(file(p3, 9, 2)), "8 bits, gamma 2.2, from cICP");
  EXPECT_EQ(red_of(file(p3, 9, 2)), 0.708f);
  EXPECT_EQ(signal_of(file(iccp(rgb_table()), 9, 2)), "8 bits, the profile's table, from iCCP");
  // Behind the profile come the other chunks, which count if it cannot be used.
  const std::string gamma = chunk("gAMA", big_endian(100000)), srgb = chunk("sRGB", std::string(1, '\0'));
  EXPECT_EQ(signal_of(png(kGreyPatch, 3, 8, p3 + gamma)), "8 bits, gamma 2.2, from iCCP");
  const std::string bad = iccp(std::string(400, '?'));
  EXPECT_EQ(signal_of(png(kGreyPatch, 3, 8, bad + gamma)), "8 bits, linear, from gAMA");
  EXPECT_EQ(signal_of(png(kGreyPatch, 3, 8, bad + srgb)), "8 bits, sRGB, from sRGB");
  EXPECT_EQ(signal_of(png(kGreyPatch, 3, 8, bad)), "8 bits, sRGB, assumed");
}

// A profile that says code points in its tag `cicp`.
std::string with_code_points(int primaries, int transfer) {
  cmsHPROFILE profile = opened_matrix(kXyP3, kD65, {cmsBuildGamma(nullptr, 2.2)}, 4.4);
  const std::string tag = std::string("cicp\0\0\0\0", 8) + static_cast<char>(primaries) +
                          static_cast<char>(transfer) + std::string("\0\1", 2);
  EXPECT_TRUE(cmsWriteRawTag(profile, cmsSigcicpTag, tag.data(), static_cast<cmsUInt32Number>(tag.size())));
  return saved(profile);
}

TEST(IccProfile, ItsCodePointsCountBeforeItsCurves) {
  const auto file = [](int primaries, int transfer) {
    return png(kGreyPatch, 3, 8, iccp(with_code_points(primaries, transfer)));
  };
  EXPECT_EQ(signal_of(file(9, 16)), "8 bits, PQ, from iCCP");
  EXPECT_EQ(red_of(file(9, 16)), 0.708f);
  EXPECT_EQ(signal_of(file(1, 8)), "8 bits, linear, from iCCP");
  // Cameras' functions are what the curves say, and what means nothing is not used.
  for (const auto& [primaries, transfer] : {std::pair(1, 1), {1, 14}, {2, 13}, {1, 2}, {1, 77}, {77, 13}}) {
    EXPECT_EQ(signal_of(file(primaries, transfer)), "8 bits, gamma 2.2, from iCCP");
    EXPECT_EQ(red_of(file(primaries, transfer)), 0.68f);
  }
}

TEST(IccProfile, CurvesOfHdrSignalsAreKnown) {
  const auto pq = [](double v) {
    const double p = std::pow(v, 32.0 / 2523);
    return std::pow(std::max(p - 3424.0 / 4096, 0.0) / (2413.0 / 128 - 2392.0 / 128 * p), 16384.0 / 2610);
  };
  const auto hlg = [](double v) {
    return v <= 0.5 ? v * v / 3 : (std::exp((v - 0.55991073) / 0.17883277) + 0.28466892) / 12;
  };
  for (const auto& [curve, name] : {std::pair<Function, const char*>(pq, "PQ"), {hlg, "HLG"}}) {
    const std::string file = png(kGreyPatch, 3, 8, iccp(matrix(kXy2020, kD65, {table_of(4096, curve)})));
    EXPECT_EQ(signal_of(file), absl::StrCat("8 bits, ", name, ", from iCCP"));
    EXPECT_EQ(read_signal(file)->light, PictureLight::kHdr);
    EXPECT_EQ(red_of(file), 0.708f);
  }
}

TEST(IccProfile, TheUsersWordsCountBefore) {
  const std::string curves =
      png(kGreyPatch, 3, 8,
          iccp(matrix(kXyP3, kD65,
                      {table_of(256, power_of(2)), table_of(256, power_of(3)), table_of(256, power_of(2))})));
  const PictureChoice linear{.transfer = SignalTransfer::kLinear}, own{.own_values = true};
  EXPECT_EQ(signal_of(curves, linear), "8 bits, linear, from iCCP");
  EXPECT_EQ(red_of(curves, linear), 0.68f);
  EXPECT_EQ(signal_of(curves, own), "8 bits, the profile's curves, from iCCP");
  EXPECT_NEAR(light_at(*read_signal(curves, own), 0, 1), std::pow(128 / 255.0, 3), 1e-4);
  const std::string table = png(kGreyPatch, 3, 8, iccp(rgb_table()));
  EXPECT_EQ(signal_of(table, linear), "8 bits, linear, assumed");
  EXPECT_EQ(signal_of(table, own), "8 bits, sRGB, assumed");
  EXPECT_TRUE(
      says(read_signal(table, own)->notes.front(), "its ICC profile is not used, because --input-tr"));
  ASSERT_OK_AND_ASSIGN(const Image codes, read_signal(table, {.own_values = true, .keeps_signal = true}));
  EXPECT_NEAR(light_at(codes, 0, 1), 128 / 255.0, 1e-6);
}

TEST(IccProfile, AlphaMultipliesItsLight) {
  const std::string row = {'\x80', '\x80', '\x80', '\x33'};
  ASSERT_OK_AND_ASSIGN(const Image half, read_signal(png_of(1, 8, 6, row, iccp(rgb_table()))));
  ASSERT_OK_AND_ASSIGN(const Image whole, read_signal(png_of(1, 8, 2, row.substr(0, 3), iccp(rgb_table()))));
  for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(light_at(half, 0, c), 0.2 * light_at(whole, 0, c), 1e-6);
  EXPECT_FLOAT_EQ(light_at(half, 0, 3), 0.2f);
  EXPECT_EQ(light_at(whole, 0, 3), 1);
}

// The profile with these bytes in place of those at `at`.
std::string with_bytes(std::string profile, size_t at, const std::string& bytes) {
  return profile.replace(at, bytes.size(), bytes);
}

TEST(IccProfile, ANoteSaysWhyOneCannotBeUsed) {
  const std::string p3 = matrix(kXyP3, kD65, {cmsBuildGamma(nullptr, 2.2)});
  const std::string large = big_endian((8u << 20) + 4) + std::string((8u << 20), 'x');
  // A grid of 255 points to the third power is beyond the memory that one may take.
  std::string greedy = rgb_table();
  greedy[greedy.find("mft2") + 10] = '\xff';
  for (const auto& [profile, note] : {std::pair(grey(2.2), "it is of GRAY, and the picture of RGB"),
                                      {cmyk_table(), "it is of CMYK, and the picture of RGB"},
                                      {with_bytes(p3, 12, "link"), "it is of no device"},
                                      {with_bytes(p3, 16, "Lab "), "it is of Lab, and the picture of RGB"},
                                      {greedy, "its curves or tables are damaged"},
                                      {"", "it is damaged"},
                                      {p3.substr(0, 140), "it is damaged"}}) {
    ASSERT_OK_AND_ASSIGN(const Image image, read_signal(jpeg(kGreyPatch, 3, absl::StrCat(profile, " "))));
    EXPECT_EQ(image.notes.front(), absl::StrCat("its ICC profile cannot be used: ", note));
    EXPECT_EQ(image.signal, "8 bits, sRGB, assumed");
  }
  ASSERT_OK_AND_ASSIGN(const Image avifs, read_signal(avif(kGreyPatch, 3, large)));
  EXPECT_EQ(avifs.notes.front(),
            "its ICC profile cannot be used: it has 8388612 bytes; the limit is 8388608");
  EXPECT_EQ(read_signal(png(kGreyPatch, 3, 8, iccp(large)))->notes.front(),
            "its ICC profile cannot be used: it is damaged");
  EXPECT_EQ(read_signal(jpeg(kGreyPatch, 4, p3))->notes.front(),
            "its ICC profile cannot be used: it is of RGB, and the picture of CMYK");
}

TEST(IccProfile, DamagedOnesEndNothing) {
  for (const std::string& good :
       {rgb_table(), matrix(kXyP3, kD65, {table_of(64, power_of(2.1))}), grey(1.8)}) {
    const int components = good == grey(1.8) ? 1 : 3;
    for (size_t size = 0; size < good.size(); size += 1 + good.size() / 40) {
      EXPECT_OK(read_signal(png(kGreyPatch, components, 8, iccp(good.substr(0, size)))));
    }
    for (size_t at = 0; at < std::min<size_t>(good.size(), 700); ++at) {
      std::string bad = good;
      bad[at] = static_cast<char>(~bad[at]);
      EXPECT_OK(read_signal(png(kGreyPatch, components, 8, iccp(bad)))) << at;
    }
  }
}

}  // namespace
}  // namespace candela
