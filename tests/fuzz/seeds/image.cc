// Seeds of the image target: a file of each kind.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfTileDescription.h>

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "server/encode/gain_map.h"
#include "server/encode/picture.h"
#include "tests/fuzz/seeds/seeds.h"
#include "tests/support/files.h"
#include "tests/unit/image/image_support.h"

namespace candela {
namespace {

using Imath::Box2i;
using Imath::V2i;

// ---- OpenEXR ----

void write_luma_chroma(const std::string& path) {
  const std::vector<Imf::Rgba> pixels(16 * 12, Imf::Rgba(0.5f, 0.25f, 0.125f, 1.0f));
  Imf::RgbaOutputFile file(path.c_str(), Imf::Header(16, 12), Imf::WRITE_YCA);
  file.setFrameBuffer(pixels.data(), 1, 16);
  file.writePixels(12);
}

// A part without colour, then one with `channels`.
void write_parts(const std::string& path, const std::vector<ExrChannel>& channels) {
  std::vector<Imf::Header> headers(2, Imf::Header(8, 6));
  const ExrPixels pixels[] = {{headers[0], {{"Z", Imf::FLOAT, [](int, int) { return 5; }}}},
                              {headers[1], channels}};
  for (int i = 0; i < 2; ++i) {
    headers[i].setName(i == 0 ? "depth" : "beauty");
    headers[i].setType(Imf::SCANLINEIMAGE);
  }
  Imf::MultiPartOutputFile file(path.c_str(), headers.data(), 2);
  for (int i = 0; i < 2; ++i) {
    Imf::OutputPart part(file, i);
    part.setFrameBuffer(pixels[i].frame());
    part.writePixels(6);
  }
}

void write_open_exr(const std::string& folder) {
  const auto one = [](int, int) { return 1; };
  for (int c = 0; c < Imf::NUM_COMPRESSION_METHODS; ++c) {
    Imf::Header header(20, 36);
    header.compression() = static_cast<Imf::Compression>(c);
    write_scan_lines(absl::StrCat(folder, "/lines_", c, ".exr"), header, rgb_channels());
    write_tiles(absl::StrCat(folder, "/tiles_", c, ".exr"), header, Imf::TileDescription(16, 16),
                rgb_channels(), 0);
  }
  for (const auto type : {Imf::FLOAT, Imf::UINT}) {
    const auto value = [](int x, int y) { return x + y; };
    write_scan_lines(absl::StrCat(folder, "/grey_", type, ".exr"), Imf::Header(9, 5), {{"Y", type, value}});
  }
  write_scan_lines(folder + "/mixed.exr", Imf::Header(9, 20),
                   {{"R", Imf::HALF, one}, {"G", Imf::FLOAT, one}, {"B", Imf::UINT, one}});
  for (const auto mode : {Imf::MIPMAP_LEVELS, Imf::RIPMAP_LEVELS}) {
    write_tiles(absl::StrCat(folder, "/levels_", mode, ".exr"), Imf::Header(20, 12),
                Imf::TileDescription(8, 4, mode), rgb_channels(), 0);
  }
  Imf::Header windows(Box2i(V2i(-3, 5), V2i(12, 14)), Box2i(V2i(-20, -30), V2i(20, 30)), 1.5f);
  Imf::addChromaticities(
      windows, Imf::Chromaticities({0.7347f, 0.2653f}, {0, 1}, {0.0001f, -0.077f}, {0.32168f, 0.33767f}));
  windows.lineOrder() = Imf::DECREASING_Y;
  write_scan_lines(folder + "/windows.exr", windows, rgb_channels(Imf::HALF, "beauty."));
  write_luma_chroma(folder + "/luma_chroma.exr");
  write_parts(folder + "/parts.exr", rgb_channels());
  write_parts(folder + "/luma_chroma_part.exr",
              {{"Y", Imf::HALF, one}, {"RY", Imf::HALF, one}, {"BY", Imf::HALF, one}});
  write_deep(folder + "/deep.exr");
}

// ---- Radiance and PFM ----

void write_radiance(const std::string& folder) {
  const std::string start =
      "#?RADIANCE\nEXPOSURE=2\nPIXASPECT=0.5\nCOLORCORR=1 1 1\nFORMAT=32-bit_rle_rgbe\n\n";
  const std::string pixel("\x80\x40\x20\x81", 4);
  std::string flat = start + "-Y 3 +X 4\n";
  for (int i = 0; i < 12; ++i) flat += pixel;
  write_file(folder + "/flat.hdr", flat);
  // Each component: a run of 5, then 4 literals.
  const std::string line("\x02\x02\x00\x09", 4), component("\x85\x40\x04\x01\x02\x03\x04", 7);
  const std::string coded = line + component + component + component + component;
  write_file(folder + "/by_component.hdr", start + "+Y 2 -X 9\n" + coded + coded);
  // A pixel and 258 repetitions of it: 2, and 1 in the next higher byte.
  write_file(folder + "/by_pixel.hdr", start + "+X 1 -Y 259\n" + pixel + std::string("\1\1\1\2\1\1\1\1", 8));
  write_file(
      folder + "/xyze.hdr",
      "#?RGBE\nPRIMARIES=0.64 0.33 0.3 0.6 0.15 0.06 0.3 0.3\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n" + pixel);
}

void write_pfm(const std::string& folder) {
  const std::string one("\x00\x00\x80\x3f", 4);
  std::string pixels;
  for (int i = 0; i < 6; ++i) pixels += one;
  write_file(folder + "/colour.pfm", "PF\n2 1\n-1.0\n" + pixels);
  write_file(folder + "/grey.pfm", "Pf\n3 2\n2.5\n" + pixels);
}

void write_png(const std::string& folder) {
  Image image = *make_image(5, 3, ImageFormat::kRgba16);
  (void)write_image(folder + "/codes_16.png", image);
  image = *make_image(5, 3, ImageFormat::kRgba8);
  (void)write_image(folder + "/codes_8.png", image, {.transfer = EncodedTransfer::kGamma22});
  image = *make_image(5, 3, ImageFormat::kRgba16);
  (void)write_image(folder + "/pq.png", image, {.transfer = EncodedTransfer::kPq});
}

// A picture turned by Exif, with a map of half its size.
void write_jpeg(const std::string& folder) {
  const std::vector<std::byte> codes(size_t{4} * 16 * 16, std::byte{90});
  std::string base;
  (void)encode_jpeg({.width = 16, .height = 16, .rows = codes.data(), .row_stride_bytes = 64}, {},
                    [&base](const void* bytes, size_t count) {
                      base.append(static_cast<const char*>(bytes), count);
                      return true;
                    });
  const std::string exif(
      "\xff\xe1\0\x22"
      "Exif\0\0MM\0\x2a\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0",
      36);
  base.insert(2, exif);
  write_file(folder + "/plain.jpg", base);
  for (const bool one_channel : {true, false}) {
    const std::vector<uint8_t> gains(size_t{8} * 8 * (one_channel ? 1 : 3), 90);
    const GainMapMetadata metadata{.max_log2 = {2, 2, 2}, .headroom_hdr_log2 = 2, .one_channel = one_channel};
    write_file(folder + (one_channel ? "/gain_map.jpg" : "/gain_maps.jpg"),
               *join_gain_map(base, *encode_gain_map(gains, 8, 8, one_channel), metadata));
  }
}

void write_y4m(const std::string& folder) {
  struct Kind {
    const char* name;
    const char* words;
    size_t frame_bytes;
  };
  for (const Kind& kind :
       {Kind{"420", "C420jpeg", 4 * 4 + 2 * 4}, Kind{"444p10", "C444p10 XCOLORRANGE=FULL", 3 * 4 * 4 * 2},
        Kind{"mono", "Cmono A4:3", 4 * 4}}) {
    const std::string frame = "FRAME\n" + std::string(kind.frame_bytes, 'x');
    write_file(absl::StrCat(folder, "/", kind.name, ".y4m"),
               absl::StrCat("YUV4MPEG2 W4 H4 F24:1 ", kind.words, "\n", frame, frame));
  }
}

}  // namespace

void write_image_seeds(const std::string& folder) {
  write_open_exr(folder);
  write_radiance(folder);
  write_png(folder);
  write_jpeg(folder);
  write_pfm(folder);
  write_y4m(folder);
}

}  // namespace candela
