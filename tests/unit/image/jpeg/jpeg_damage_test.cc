// Damaged, hostile and unsupported JPEG files as input.

// jpeglib.h needs FILE and size_t to be declared before it.
#include <cstdio>

// clang-format off
#include <jpeglib.h>
// clang-format on

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/image/image.h"
#include "tests/support/status.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/jpeg/jpeg_files.h"

namespace candela {
namespace {

TEST(JpegReader, MetadataThatMeansNothingIsRefused) {
  const std::string file = joined(jpeg_of(8, 8, flat(90)), map_of(8, 8, true, flat(255)), stops_of(1));
  const auto changed = [&](size_t at, const std::string& bytes) {
    return read_jpeg_bytes(
        with_iso(file, std::string("\0\0\0\0\x40", 5) +
                           std::string("\0\0\0\0\0\0\0\1\0\0\0\1\0\0\0\1", 16).substr(0, at) + bytes));
  };
  EXPECT_REFUSED(kInvalidArgument, "file: damaged gain map: the base's headroom of the gain map is nan",
                 changed(4, std::string(4, '\0')));
  EXPECT_REFUSED(kInvalidArgument, "its own picture is the HDR one", changed(0, std::string("\0\0\0\2", 4)));
  EXPECT_REFUSED(kInvalidArgument, "its own picture is the HDR one",
                 read_jpeg_bytes(with_iso(file, std::string("\0\0\0\0\x44", 5))));
  EXPECT_REFUSED(kInvalidArgument, "the ISO 21496-1 metadata of the gain map ends too early",
                 read_jpeg_bytes(with_iso(file, std::string("\0\0\0\0\xc0", 5))));
  const std::string by_xmp = renamed(file, kIsoGainMap, "urn:iso:std:iso:ts:99999:-1");
  EXPECT_REFUSED(kInvalidArgument, "its own picture is the HDR one",
                 read_jpeg_bytes(renamed(by_xmp, "\"False\"", "\"True\" ")));
  EXPECT_REFUSED(kInvalidArgument, "hdrgm:GainMapMax of the gain map is not 1 or 3 numbers",
                 read_jpeg_bytes(renamed(by_xmp, "hdrgm:GainMapMax=\"1\"", "hdrgm:GainMapMax=\"x\"")));
  EXPECT_REFUSED(kInvalidArgument, "the gamma of the gain map is 0; it must be within 0.01 .. 100",
                 read_jpeg_bytes(renamed(by_xmp, "hdrgm:Gamma=\"1\"", "hdrgm:Gamma=\"0\"")));
  EXPECT_REFUSED(kInvalidArgument, "the gain map has no hdrgm:HDRCapacityMax",
                 read_jpeg_bytes(renamed(by_xmp, "hdrgm:HDRCapacityMax", "hdrgm:hdrCapacityMax")));
}

TEST(JpegReader, AMapThatIsNotThereIsNamed) {
  const std::string base = jpeg_of(8, 8, flat(90));
  const std::string file = joined(base, map_of(8, 8, true, flat(255)), stops_of(1));
  const size_t map_at = file.find("\xff\xd9\xff\xd8") + 2;
  const std::string cut = file.substr(0, file.size() - 10);
  EXPECT_REFUSED(kInvalidArgument,
                 absl::StrFormat("file: damaged gain map: its MPF places a picture at bytes %d to %d; "
                                 "the file has %d; --incomplete fill renders what is there",
                                 map_at, file.size(), cut.size()),
                 read_jpeg_bytes(cut));
  ASSERT_OK_AND_ASSIGN(const Image filled, read_jpeg_bytes(cut, {.fills_gaps = true}));
  EXPECT_FALSE(filled.display_light);
  EXPECT_TRUE(has_note(filled, "the SDR picture is shown"));
  const std::string nowhere = renamed(renamed(file, std::string("MPF\0", 4), std::string("MPX\0", 4)),
                                      "<Container:Item", "<Kontainer:Item");
  ASSERT_OK_AND_ASSIGN(const Image image, read_jpeg_bytes(nowhere));
  EXPECT_TRUE(
      has_note(image, "the file says that it has a gain map, but it has none: the SDR picture is shown"));
  std::string damaged = file;
  damaged.replace(map_at + 1, 1, "\xd9");
  EXPECT_REFUSED(kInvalidArgument, "no JPEG picture begins there", read_jpeg_bytes(damaged));
}

// A file of `components` components in this colour space.
std::string jpeg_in(J_COLOR_SPACE space, int components, bool progressive = false) {
  jpeg_compress_struct codec{};
  jpeg_error_mgr errors{};
  codec.err = jpeg_std_error(&errors);
  jpeg_create_compress(&codec);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&codec, &bytes, &size);
  codec.image_width = codec.image_height = 8;
  codec.input_components = components;
  codec.in_color_space = space;
  jpeg_set_defaults(&codec);
  if (progressive) jpeg_simple_progression(&codec);
  jpeg_start_compress(&codec, TRUE);
  std::vector<unsigned char> row(static_cast<size_t>(8 * components), 90);
  for (JSAMPROW at = row.data(); codec.next_scanline < 8;) jpeg_write_scanlines(&codec, &at, 1);
  jpeg_finish_compress(&codec);
  jpeg_destroy_compress(&codec);
  const std::string file(reinterpret_cast<char*>(bytes), size);
  std::free(bytes);
  return file;
}

TEST(JpegReader, OtherColoursAreRefusedByName) {
  EXPECT_REFUSED(kInvalidArgument, "file: the picture is in CMYK, the inks of a printer; convert it to RGB",
                 read_jpeg_bytes(jpeg_in(JCS_CMYK, 4)));
  EXPECT_REFUSED(kInvalidArgument, "file: the picture has 2 components; Candela reads grey and RGB",
                 read_jpeg_bytes(jpeg_in(JCS_UNKNOWN, 2)));
  EXPECT_REFUSED(kInvalidArgument, "file: the gain map is in CMYK",
                 read_jpeg_bytes(joined(jpeg_of(8, 8, flat(1)), jpeg_in(JCS_CMYK, 4), stops_of(1))));
}

// Each scan takes the time of the whole picture.
TEST(JpegReader, ScansAreCounted) {
  const std::string file = jpeg_in(JCS_RGB, 3, true);
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
  EXPECT_REFUSED(kResourceExhausted, "the gain map is 64x8 pixels; the limit is 48 on a side",
                 read_jpeg_bytes(joined(base, map, stops_of(1)), {}, {.max_dimension = 48}));
  EXPECT_REFUSED(kResourceExhausted, "--max-pixels allows 100",
                 read_jpeg_bytes(base, {}, {.max_pixels = 100}));
  // The size of the frame, 65000 x 65000, is all that is wrong.
  std::string huge = base;
  huge.replace(huge.find("\xff\xc0") + 5, 4, "\xfd\xe8\xfd\xe8");
  EXPECT_REFUSED(kResourceExhausted, "file: the image is 65000x65000 pixels", read_jpeg_bytes(huge));
}

int noise(uint32_t x, uint32_t y, int c) {
  return static_cast<int>((x * 97 + y * 57 + x * y * 31 + 80 * c) % 256);
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
  // Without its last two bytes only the end is missing.
  EXPECT_REFUSED(kInvalidArgument, "damaged JPEG file", read_jpeg_bytes(file.substr(0, file.size() - 2)));
}

TEST(JpegReader, SurvivesAnyDamage) {
  const std::string files[] = {
      joined(jpeg_of(24, 16, noise), map_of(12, 8, true, noise), stops_of(3)),
      joined(
          with(jpeg_of(17, 9, noise),
               jpeg_segment(0xe1, std::string("Exif\0\0MM\0\x2a\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0\6", 26) +
                                      std::string(6, '\0'))),
          map_of(17, 9, false, noise), three_channels())};
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

}  // namespace
}  // namespace candela
