// TIFF files, read back by libtiff.
#include <gtest/gtest.h>
#include <lcms2.h>
#include <tiffio.h>

#include <cstring>
#include <vector>

#include "client/image/image.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

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
