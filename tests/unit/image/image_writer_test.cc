#include <gtest/gtest.h>
#include <lcms2.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <csignal>
#include <cstring>

#include "client/image/write/encodings.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png.h"
// jpeglib.h needs FILE and size_t declared before it.
#include <cstdio>
// clang-format off
#include <jpeglib.h>
#include <tiffio.h>
#include <vector>
#include "client/image/image.h"

// clang-format on

namespace candela {
namespace {

Image test_image(uint32_t width, uint32_t height, ImageFormat format, bool alpha) {
  Image image = *make_image(width, height, format);
  image.has_alpha = alpha;
  const size_t components = size_t{4} * width * height;
  for (size_t i = 0; i < components; ++i) {
    const bool is_alpha = i % 4 == 3;
    std::byte* at = image.pixels.data() + i * bytes_per_pixel(format) / 4;
    const auto byte = static_cast<uint8_t>(i * 37);
    const auto code = static_cast<uint16_t>(is_alpha ? 40000 : i * 7919);
    const auto half = static_cast<uint16_t>(0x3000 + i * 13 % 0x1000);
    const auto value = static_cast<float>(i) * 1.25f;
    if (format == ImageFormat::kRgba8) std::memcpy(at, &byte, 1);
    if (format == ImageFormat::kRgba16) std::memcpy(at, &code, 2);
    if (format == ImageFormat::kRgba16f) std::memcpy(at, &half, 2);
    if (format == ImageFormat::kRgba32f) std::memcpy(at, &value, 4);
  }
  return image;
}

class ImageWriter : public ::testing::Test {
 protected:
  TemporaryFolder folder_;

  std::vector<std::string> write(const std::string& name, const Image& image,
                                 const WriteOptions& options = {}) {
    auto notes = write_image(folder_.path(name), image, options);
    EXPECT_OK(notes);
    return notes.ok() ? *notes : std::vector<std::string>{};
  }
};

TEST_F(ImageWriter, StoresCodesInPngAsTheyAre) {
  for (const auto format : {ImageFormat::kRgba8, ImageFormat::kRgba16}) {
    for (const bool alpha : {false, true}) {
      const Image image = test_image(13, 7, format, alpha);
      EXPECT_TRUE(write("out.png", image).empty());
      const Png png = read_png(folder_.path("out.png"));
      ASSERT_EQ(png.width, 13u);
      ASSERT_EQ(png.height, 7u);
      ASSERT_EQ(png.depth, format == ImageFormat::kRgba8 ? 8 : 16);
      ASSERT_EQ(png.channels, alpha ? 4 : 3);
      for (uint32_t y = 0; y < 7; ++y) {
        for (uint32_t x = 0; x < 13; ++x) {
          for (int c = 0; c < png.channels; ++c) ASSERT_EQ(png.code(x, y, c), component(image, x, y, c));
        }
      }
      EXPECT_EQ(png.density_x, 0u);
    }
  }
}

TEST_F(ImageWriter, SaysInAPngHowItIsEncodedAndWhatShapeItsPixelsHave) {
  Image image = test_image(2, 2, ImageFormat::kRgba8, false);
  image.pixel_aspect = 1.5;
  write("out.png", image);
  Png png = read_png(folder_.path("out.png"));
  EXPECT_TRUE(png.srgb);
  EXPECT_EQ(png.density_x, 2u);  // a wide pixel: fewer of them to the metre
  EXPECT_EQ(png.density_y, 3u);
  write("out.png", image, {.transfer = EncodedTransfer::kGamma22});
  png = read_png(folder_.path("out.png"));
  EXPECT_FALSE(png.srgb);
  EXPECT_NEAR(png.gamma, 1 / 2.2, 1e-4);
  EXPECT_NEAR(png.red_x, 0.64, 1e-4);
  write("out.png", image, {.transfer = EncodedTransfer::kLinear});
  EXPECT_NEAR(read_png(folder_.path("out.png")).gamma, 1.0, 1e-4);
  write("deep.png", test_image(2, 2, ImageFormat::kRgba16, false));
  EXPECT_TRUE(read_png(folder_.path("deep.png")).srgb);
}

// Codes that are all 0 may be those of a faint picture, so they decide nothing.
TEST_F(ImageWriter, AlphaCodesOfZeroStayInAPng) {
  Image image = test_image(5, 5, ImageFormat::kRgba8, true);
  for (size_t i = 3; i < image.pixels.size(); i += 4) image.pixels.data()[i] = std::byte{0};
  EXPECT_TRUE(write("out.png", image).empty());
  EXPECT_EQ(read_png(folder_.path("out.png")).channels, 4);
}

TEST_F(ImageWriter, WritesJpegAtFullChromaWithItsAspect) {
  Image image = *make_image(16, 16, ImageFormat::kRgba8);
  for (size_t i = 0; i < image.pixels.size(); ++i) {
    const bool red = i / 4 % 2 == 0;  // stripes one pixel wide, which subsampled chroma would blend
    image.pixels.data()[i] = std::byte{static_cast<uint8_t>(i % 4 == (red ? 0 : 2) ? 220 : 30)};
  }
  image.has_alpha = true;
  image.pixel_aspect = 0.5;
  EXPECT_EQ(write("out.JPG", image, {.jpeg_quality = 98}),
            std::vector<std::string>{"alpha dropped: .jpg has none"});

  std::FILE* file = std::fopen(folder_.path("out.JPG").c_str(), "rb");
  ASSERT_NE(file, nullptr);
  jpeg_decompress_struct codec{};
  jpeg_error_mgr errors{};
  codec.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&codec);
  jpeg_stdio_src(&codec, file);
  jpeg_read_header(&codec, TRUE);
  EXPECT_EQ(codec.density_unit, 0);
  EXPECT_EQ(codec.X_density, 2);
  EXPECT_EQ(codec.Y_density, 1);
  jpeg_start_decompress(&codec);
  ASSERT_EQ(codec.output_width, 16u);
  std::vector<uint8_t> row(16 * 3);
  uint8_t* rows[] = {row.data()};
  jpeg_read_scanlines(&codec, rows, 1);
  for (int x = 0; x < 16; ++x) {
    EXPECT_NEAR(row[3 * x], x % 2 == 0 ? 220 : 30, 12) << x;
    EXPECT_NEAR(row[3 * x + 2], x % 2 == 0 ? 30 : 220, 12) << x;
  }
  jpeg_abort_decompress(&codec);
  jpeg_destroy_decompress(&codec);
  std::fclose(file);
}

// The ICC profile in a JPEG file.
std::string profile_in(const std::string& path) {
  std::FILE* file = std::fopen(path.c_str(), "rb");
  jpeg_decompress_struct codec{};
  jpeg_error_mgr errors{};
  codec.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&codec);
  jpeg_stdio_src(&codec, file);
  jpeg_save_markers(&codec, JPEG_APP0 + 2, 0xffff);
  jpeg_read_header(&codec, TRUE);
  JOCTET* bytes = nullptr;
  unsigned size = 0;
  std::string profile;
  if (jpeg_read_icc_profile(&codec, &bytes, &size)) profile.assign(reinterpret_cast<char*>(bytes), size);
  std::free(bytes);
  jpeg_destroy_decompress(&codec);
  std::fclose(file);
  return profile;
}

TEST_F(ImageWriter, AJpegCarriesTheProfileOfItsTransfer) {
  const Image image = test_image(4, 4, ImageFormat::kRgba8, false);
  for (const auto& [transfer, code] :
       std::vector<std::pair<EncodedTransfer, double>>{{EncodedTransfer::kSrgb, 188},
                                                       {EncodedTransfer::kGamma22, 186},
                                                       {EncodedTransfer::kLinear, 128}}) {
    write("a.jpg", image, {.transfer = transfer});
    const std::string profile = profile_in(folder_.path("a.jpg"));
    ASSERT_LT(profile.size(), 1000u);
    // Half the light of the screen's white has `code` in that transfer; sRGB has 188.
    cmsHPROFILE from = cmsOpenProfileFromMem(profile.data(), static_cast<cmsUInt32Number>(profile.size()));
    ASSERT_NE(from, nullptr);
    cmsHPROFILE to = cmsCreate_sRGBProfile();
    cmsHTRANSFORM transform =
        cmsCreateTransform(from, TYPE_RGB_8, to, TYPE_RGB_8, INTENT_RELATIVE_COLORIMETRIC, cmsFLAGS_NOCACHE);
    ASSERT_NE(transform, nullptr);
    const auto value = static_cast<uint8_t>(code);
    const uint8_t in[] = {value, value, value, 255, 0, 0};
    uint8_t out[6] = {};
    cmsDoTransform(transform, in, out, 2);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(out[c], 188, 1) << code;
    const int red[] = {255, 0, 0};  // the same primaries
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(out[3 + c], red[c], 1) << code;
    cmsDeleteTransform(transform);
    cmsCloseProfile(from);
    cmsCloseProfile(to);
  }
  write("unknown.jpg", image, {.transfer = EncodedTransfer::kUnknown});
  EXPECT_EQ(profile_in(folder_.path("unknown.jpg")), "");
}

TEST_F(ImageWriter, TheSameJpegIsTheSameBytesAtAnyTime) {
  const Image image = test_image(4, 4, ImageFormat::kRgba8, false);
  write("a.jpg", image);
  // The date in an ICC profile's header: 1 January 2010, 0:00.
  EXPECT_EQ(profile_in(folder_.path("a.jpg")).substr(24, 12),
            std::string("\x07\xda\0\1\0\1\0\0\0\0\0\0", 12));
}

TEST_F(ImageWriter, RoundTripsOpenExrBitForBit) {
  for (const auto format : {ImageFormat::kRgba16f, ImageFormat::kRgba32f}) {
    for (const bool alpha : {false, true}) {
      Image image = test_image(33, 19, format, alpha);
      image.pixel_aspect = 2;
      image.frame_rate = FrameRate{24000, 1001};
      for (size_t x = 0; !alpha && x < 33 * 19; ++x) {
        const uint16_t half_one = 0x3c00;
        const float one = 1;
        std::byte* at = image.pixels.data() + x * bytes_per_pixel(format) + 3 * bytes_per_pixel(format) / 4;
        if (format == ImageFormat::kRgba16f) std::memcpy(at, &half_one, 2);
        if (format == ImageFormat::kRgba32f) std::memcpy(at, &one, 4);
      }
      EXPECT_TRUE(write("out.exr", image).empty());
      ASSERT_OK_AND_ASSIGN(const auto back, read_image(folder_.path("out.exr")));
      EXPECT_TRUE(same_pixels(image, back));
      EXPECT_EQ(back.has_alpha, alpha);
      EXPECT_EQ(back.pixel_aspect, 2);
      EXPECT_EQ(back.frame_rate, image.frame_rate);
      EXPECT_TRUE(back.names_primaries);
      EXPECT_FALSE(back.chromaticities.has_value());
    }
  }
}

TEST_F(ImageWriter, RoundTripsPfmAndSaysWhatItLost) {
  for (const auto format : {ImageFormat::kRgba16f, ImageFormat::kRgba32f}) {
    Image image = test_image(5, 4, format, true);
    image.pixel_aspect = 2;
    EXPECT_EQ(write("out.pfm", image).size(), 2u);
    ASSERT_OK_AND_ASSIGN(const auto back, read_image(folder_.path("out.pfm")));
    for (uint32_t y = 0; y < 4; ++y) {
      for (uint32_t x = 0; x < 5; ++x) {
        for (int c = 0; c < 3; ++c) ASSERT_EQ(component(back, x, y, c), component(image, x, y, c));
      }
    }
  }
}

TEST_F(ImageWriter, ListsTheExtensionsForAnUnknownOne) {
  for (const char* name : {"out.webp", "out", "png", ".png", "out.png.bak"}) {
    EXPECT_REFUSED(kInvalidArgument, ".png, .jpg, .jpeg, .tif, .tiff, .avif, .exr or .pfm",
                   output_encoding(name));
  }
  EXPECT_STREQ((*output_encoding("a.b/out.JPEG"))->name, "JPEG");
  EXPECT_STREQ((*output_encoding("out.Png"))->name, "PNG");
}

TEST_F(ImageWriter, RefusesAFormatThatTheFileCannotHold) {
  const Image halves = test_image(2, 2, ImageFormat::kRgba16f, false),
              codes = test_image(2, 2, ImageFormat::kRgba16, false);
  EXPECT_FALSE(write_image(folder_.path("a.png"), halves).ok());
  EXPECT_FALSE(write_image(folder_.path("a.jpg"), codes).ok());
  EXPECT_FALSE(write_image(folder_.path("a.tif"), halves).ok());
  EXPECT_FALSE(write_image(folder_.path("a.exr"), codes).ok());
  EXPECT_FALSE(write_image(folder_.path("a.pfm"), codes).ok());
  EXPECT_FALSE(
      write_image(folder_.path("a.jpg"), test_image(2, 2, ImageFormat::kRgba8, false), {.jpeg_quality = 0})
          .ok());
  EXPECT_FALSE(write_image(folder_.path("a.png"), Image{}).ok());
  EXPECT_TRUE(folder_.list().empty());
}

TEST_F(ImageWriter, NamesThePathAndTheReasonOfAnUnwritableOne) {
  const Image image = test_image(2, 2, ImageFormat::kRgba8, false);
  const auto error = [&](const std::string& path) {
    EXPECT_EQ(check_output_path(path).status(), write_image(path, image).status());
    return std::string(check_output_path(path).status().message());
  };
  EXPECT_EQ(error(folder_.path("none/out.png")),
            folder_.path("none/out.png") + ": cannot write: No such file or directory");
  ASSERT_EQ(mkdir(folder_.path("folder.png").c_str(), 0700), 0);
  EXPECT_TRUE(says(error(folder_.path("folder.png")), "Is a directory"));
  ASSERT_EQ(mkfifo(folder_.path("pipe.png").c_str(), 0600), 0);
  EXPECT_EQ(error(folder_.path("pipe.png")),
            folder_.path("pipe.png") + ": cannot write: this is a FIFO; name a plain file");
  ASSERT_EQ(symlink("/dev/null", folder_.path("null.png").c_str()), 0);
  EXPECT_TRUE(says(error(folder_.path("null.png")), "null.png: cannot write: this is a device"));
  ASSERT_EQ(symlink("nowhere/out.png", folder_.path("dangling.png").c_str()), 0);
  EXPECT_TRUE(says(error(folder_.path("dangling.png")), "No such file or directory"));
  if (geteuid() != 0) {  // root may write anywhere
    ASSERT_EQ(mkdir(folder_.path("closed").c_str(), 0500), 0);
    EXPECT_TRUE(says(error(folder_.path("closed/out.png")), "Permission denied"));
    write_file(folder_.path("kept.png"), "old");
    chmod(folder_.path("kept.png").c_str(), 0400);
    EXPECT_TRUE(says(error(folder_.path("kept.png")), "Permission denied"));
  }
}

TEST_F(ImageWriter, LeavesTheOldFileWhenTheDiskIsFull) {
  // A limit on the file size simulates a full disk.
  rlimit old{};
  getrlimit(RLIMIT_FSIZE, &old);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  for (const OutputEncoding& encoding : output_encodings()) {
    const std::string name = "out" + encoding.extension();
    const Image image = test_image(700, 500, encoding.formats.front(), false);
    write_file(folder_.path(name), "old");
    rlimit small = old;
    small.rlim_cur = 4096;
    setrlimit(RLIMIT_FSIZE, &small);
    const absl::Status status = write_image(folder_.path(name), image).status();
    setrlimit(RLIMIT_FSIZE, &old);
    EXPECT_EQ(std::string(status.message()), folder_.path(name) + ": cannot write: File too large");
    EXPECT_EQ(read_file(folder_.path(name)), "old");
  }
  std::signal(SIGXFSZ, handler);
  EXPECT_EQ(folder_.list().size(), output_encodings().size());
}

TEST_F(ImageWriter, ReplacesTheOldFileAndLeavesNothingBeside) {
  write_file(folder_.path("out.png"), "old");
  write("out.png", test_image(3, 3, ImageFormat::kRgba8, false));
  EXPECT_EQ(folder_.list(), std::vector<std::string>{"out.png"});
  EXPECT_EQ(read_png(folder_.path("out.png")).width, 3u);
}

TEST_F(ImageWriter, KeepsTheOldFilesPermissionsAndLinks) {
  struct stat info {};
  const auto mode_of = [&](const char* name) {
    EXPECT_EQ(stat(folder_.path(name).c_str(), &info), 0);
    return info.st_mode & 07777;
  };
  const Image image = test_image(3, 3, ImageFormat::kRgba8, false);
  const mode_t mask = umask(027);
  write("new.png", image);
  EXPECT_EQ(mode_of("new.png"), 0640u);
  for (const mode_t mode : {0600u, 0666u}) {
    ASSERT_EQ(chmod(folder_.path("new.png").c_str(), mode), 0);
    write("new.png", image);
    EXPECT_EQ(mode_of("new.png"), mode);
  }
  umask(mask);

  ASSERT_EQ(mkdir(folder_.path("store").c_str(), 0700), 0);
  write_file(folder_.path("store/real.png"), "old");
  ASSERT_EQ(symlink("store/real.png", folder_.path("link.png").c_str()), 0);
  write("link.png", image);
  ASSERT_EQ(lstat(folder_.path("link.png").c_str(), &info), 0);
  EXPECT_TRUE(S_ISLNK(info.st_mode));
  EXPECT_EQ(read_png(folder_.path("store/real.png")).width, 3u);
}

// TIFF files, read back by libtiff.

// Every component differs from its neighbours, and a strip from the next.
Image coded_image(uint32_t width, uint32_t height, ImageFormat format, bool alpha) {
  Image image = *make_image(width, height, format);
  image.has_alpha = alpha;
  const size_t bytes = bytes_per_pixel(format) / 4;
  for (size_t i = 0; i < size_t{4} * width * height; ++i) {
    const auto code = static_cast<uint16_t>(i * 7919 + i / 4096);
    std::memcpy(image.pixels.data() + i * bytes, &code, bytes);
  }
  return image;
}

struct TiffFile {
  uint32_t width = 0, height = 0;
  uint16_t bits = 0, channels = 0, alpha = 0, photometric = 0, compression = 0, orientation = 0;
  float density_x = 0, density_y = 0;
  std::string profile;
  std::vector<uint8_t> rows;  // the machine's byte order

  int code(uint32_t x, uint32_t y, int c) const {
    const size_t i = (size_t{y} * width + x) * channels + c;
    if (bits == 8) return rows[i];
    uint16_t value;
    std::memcpy(&value, &rows[2 * i], sizeof value);
    return value;
  }
};

TiffFile read_tiff(const std::string& path) {
  TiffFile file;
  TIFF* tiff = TIFFOpen(path.c_str(), "r");
  if (tiff == nullptr) return file;
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &file.width);
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &file.height);
  TIFFGetField(tiff, TIFFTAG_BITSPERSAMPLE, &file.bits);
  TIFFGetField(tiff, TIFFTAG_SAMPLESPERPIXEL, &file.channels);
  TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &file.photometric);
  TIFFGetField(tiff, TIFFTAG_COMPRESSION, &file.compression);
  TIFFGetField(tiff, TIFFTAG_ORIENTATION, &file.orientation);
  TIFFGetField(tiff, TIFFTAG_XRESOLUTION, &file.density_x);
  TIFFGetField(tiff, TIFFTAG_YRESOLUTION, &file.density_y);
  uint16_t extras = 0, *kinds = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_EXTRASAMPLES, &extras, &kinds) != 0 && extras == 1) file.alpha = kinds[0];
  uint32_t bytes = 0;
  void* profile = nullptr;
  if (TIFFGetField(tiff, TIFFTAG_ICCPROFILE, &bytes, &profile) != 0) {
    file.profile.assign(static_cast<const char*>(profile), bytes);
  }
  const auto row_bytes = static_cast<size_t>(TIFFScanlineSize(tiff));
  file.rows.resize(row_bytes * file.height);
  for (uint32_t y = 0; y < file.height; ++y) {
    EXPECT_EQ(TIFFReadScanline(tiff, &file.rows[y * row_bytes], y, 0), 1);
  }
  EXPECT_EQ(TIFFLastDirectory(tiff), 1) << "the file has a second picture";
  TIFFClose(tiff);
  return file;
}

class TiffWriter : public ::testing::Test {
 protected:
  TiffFile written(const Image& image, const WriteOptions& options = {}) {
    const auto notes = write_image(folder_.path("out.tif"), image, options);
    EXPECT_OK(notes);
    EXPECT_EQ(notes.value_or(std::vector<std::string>{"failed"}), std::vector<std::string>());
    return read_tiff(folder_.path("out.tif"));
  }

  TemporaryFolder folder_;
};

TEST_F(TiffWriter, StoresCodesAsTheyAreAtEverySizeAndDepth) {
  struct Size {
    uint32_t width, height;
  };
  // The last two have several strips, of which the last is short, and a row larger than a strip.
  for (const auto& [width, height] : {Size{1, 1}, {1, 5}, {7, 1}, {13, 7}, {1021, 1031}, {150001, 2}}) {
    for (const auto format : {ImageFormat::kRgba8, ImageFormat::kRgba16}) {
      for (const bool alpha : {false, true}) {
        const Image image = coded_image(width, height, format, alpha);
        const TiffFile tiff = written(image);
        ASSERT_EQ(tiff.width, width);
        ASSERT_EQ(tiff.height, height);
        ASSERT_EQ(tiff.bits, format == ImageFormat::kRgba8 ? 8 : 16);
        ASSERT_EQ(tiff.channels, alpha ? 4 : 3);
        size_t wrong = 0;
        for (uint32_t y = 0; y < height; ++y) {
          for (uint32_t x = 0; x < width; ++x) {
            for (int c = 0; c < tiff.channels; ++c) {
              wrong += static_cast<float>(tiff.code(x, y, c)) != component(image, x, y, c);
            }
          }
        }
        EXPECT_EQ(wrong, 0u) << width << "x" << height;
      }
    }
  }
}

TEST_F(TiffWriter, SaysWhatItsPixelsAre) {
  Image image = coded_image(5, 3, ImageFormat::kRgba8, true);
  image.pixel_aspect = 1.5;
  const TiffFile straight = written(image);
  EXPECT_EQ(straight.photometric, PHOTOMETRIC_RGB);
  EXPECT_EQ(straight.orientation, ORIENTATION_TOPLEFT);
  EXPECT_EQ(straight.compression, COMPRESSION_ADOBE_DEFLATE);
  EXPECT_EQ(straight.alpha, EXTRASAMPLE_UNASSALPHA);
  EXPECT_EQ(straight.density_x, 2.0f);  // wide pixels: fewer of them to a unit
  EXPECT_EQ(straight.density_y, 3.0f);
  EXPECT_EQ(written(image, {.associated_alpha = true}).alpha, EXTRASAMPLE_ASSOCALPHA);
}

TEST_F(TiffWriter, CarriesTheProfileOfItsTransfer) {
  const Image image = coded_image(4, 4, ImageFormat::kRgba16, false);
  for (const auto& [transfer, name] :
       std::vector<std::pair<EncodedTransfer, std::string>>{{EncodedTransfer::kSrgb, "sRGB"},
                                                            {EncodedTransfer::kGamma22, "Rec.709, gamma 2.2"},
                                                            {EncodedTransfer::kLinear, "Rec.709, linear"}}) {
    const std::string bytes = written(image, {.transfer = transfer}).profile;
    cmsHPROFILE profile = cmsOpenProfileFromMem(bytes.data(), static_cast<cmsUInt32Number>(bytes.size()));
    ASSERT_NE(profile, nullptr) << name;
    char description[100] = "";
    cmsGetProfileInfoASCII(profile, cmsInfoDescription, "en", "US", description, sizeof description);
    EXPECT_EQ(description, name);
    cmsCloseProfile(profile);
  }
  EXPECT_EQ(written(image, {.transfer = EncodedTransfer::kUnknown}).profile, "");
}

TEST_F(TiffWriter, TheSamePictureGivesTheSameFile) {
  const Image image = coded_image(101, 67, ImageFormat::kRgba16, true);
  written(image);
  const std::string first = read_file(folder_.path("out.tif"));
  ASSERT_OK(write_image(folder_.path("again.tiff"), image));
  EXPECT_TRUE(read_file(folder_.path("again.tiff")) == first);
}

}  // namespace
}  // namespace candela
