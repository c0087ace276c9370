// The seeds of the fuzz targets.
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfRgbaFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfTileDescription.h>
#include <tiffio.h>
#include <zlib.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/band_wire.h"
#include "proto/candela/v1/pixel_size.h"
#include "server/encode/gain_map.h"
#include "server/encode/picture.h"
#include "tests/fuzz/wire_input.h"
#include "tests/support/files.h"
#include "tests/unit/image/image_support.h"
#include "tests/unit/image/png.h"

namespace candela {
namespace {

// Each writes its files into a folder that there is.

// Seeds of the image target: a file of each kind.

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
  write_file(folder + "/text_before.hdr", "Photo\n\n" + flat);
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

// Exif of orientation 6, from its TIFF header on.
const std::string kTurned("MM\0\x2a\0\0\0\x08\0\1\x01\x12\0\3\0\0\0\1\0\6\0\0\0\0\0\0", 26);

void write_png(const std::string& folder) {
  Image image = *make_image(5, 3, ImageFormat::kRgba16);
  (void)write_image(folder + "/codes_16.png", image);
  image = *make_image(5, 3, ImageFormat::kRgba8);
  (void)write_image(folder + "/codes_8.png", image, {.transfer = EncodedTransfer::kGamma22});
  image = *make_image(5, 3, ImageFormat::kRgba16);
  (void)write_image(folder + "/pq.png", image, {.transfer = EncodedTransfer::kPq});
  write_file(folder + "/turned.png", png_of(1, 8, 0, "\x80", chunk("eXIf", kTurned)));
  std::string damaged = chunk("gAMA", big_endian(50000));
  damaged.back() ^= 1;
  write_file(folder + "/checksum.png", png_of(1, 8, 0, "\x80", damaged));
}

std::string jpeg_segment(char marker, const std::string& body) {
  const size_t length = body.size() + 2;
  return std::string{'\xff', marker, static_cast<char>(length >> 8), static_cast<char>(length)} + body;
}

// Apple's kind, with a headroom of its own, or with the maker note's numbers 33 and 48 of 1 and 0.
void write_apple(const std::string& folder, const std::string& base, const std::string& map) {
  const std::string note(
      "Apple iOS\0\0\1MM\0\2"
      "\0\x21\0\x0a\0\0\0\1\0\0\0\x2c\0\x30\0\x0a\0\0\0\1\0\0\0\x34\0\0\0\0"
      "\0\0\0\1\0\0\0\1\0\0\0\0\0\0\0\1",
      60);
  const std::string exif(
      "Exif\0\0MM\0\x2a\0\0\0\x08\0\1\x87\x69\0\4\0\0\0\1\0\0\0\x1a\0\0\0\0"
      "\0\1\x92\x7c\0\7\0\0\0\x3c\0\0\0\x2c\0\0\0\0",
      50);
  for (const char* headroom : {"", "<g:HDRGainMapHeadroom>4</g:HDRGainMapHeadroom>"}) {
    std::string file = base, with_words = map;
    if (*headroom == '\0') file.insert(2, jpeg_segment('\xe1', exif + note));
    with_words.insert(2, jpeg_segment('\xe1', absl::StrCat(kXmpName,
                                                           "<x xmlns:g='http://ns.apple.com/HDRGainMap/1.0/'>"
                                                           "<g:HDRGainMapVersion>65536</g:HDRGainMapVersion>",
                                                           headroom, "</x>")));
    write_file(folder + (*headroom == '\0' ? "/apple.jpg" : "/apple_headroom.jpg"), file + with_words);
  }
}

// Words in the file's own picture, as elements, that lead to a map without any.
void write_words_of_the_picture(const std::string& folder, std::string base, const std::string& map) {
  base.insert(
      2, jpeg_segment(
             '\xe1',
             absl::StrCat(kXmpName,
                          "<x xmlns:r='http://www.w3.org/1999/02/22-rdf-syntax-ns#'"
                          " xmlns:h='http://ns.adobe.com/hdr-gain-map/1.0/'"
                          " xmlns:c='http://ns.google.com/photos/1.0/container/'"
                          " xmlns:i='http://ns.google.com/photos/1.0/container/item/' h:Version='1.0'>"
                          "<h:GainMapMax><r:Seq><r:li>1</r:li><r:li>2</r:li><r:li>3</r:li></r:Seq>"
                          "</h:GainMapMax><h:HDRCapacityMax>3</h:HDRCapacityMax><c:Directory><r:Seq>"
                          "<r:li><c:Item i:Semantic='Primary'/></r:li><r:li><c:Item>"
                          "<i:Semantic>GainMap</i:Semantic></c:Item></r:li></r:Seq></c:Directory></x>")));
  write_file(folder + "/words_of_picture.jpg", base + map);
}

// A profile for R, G and B, or what `space` names, that claims what its bytes do not hold.
std::string profile_of(const std::string& space,
                       const std::vector<std::pair<std::string, std::string>>& tags) {
  std::string table = big_endian(static_cast<uint32_t>(tags.size())), bodies;
  const size_t first = 128 + 4 + 12 * tags.size();
  for (const auto& [name, body] : tags) {
    absl::StrAppend(&table, name, big_endian(static_cast<uint32_t>(first + bodies.size())),
                    big_endian(static_cast<uint32_t>(body.size())));
    absl::StrAppend(&bodies, body, std::string(-body.size() % 4, '\0'));
  }
  std::string head = big_endian(static_cast<uint32_t>(first + bodies.size())) + std::string(4, '\0') +
                     std::string("\2\x40\0\0", 4) + "mntr" + space + "XYZ " + std::string(12, '\0') + "acsp";
  head.resize(128);
  return head + table + bodies;
}

// Profiles of every kind of tag that is read: good ones, huge counts, tags of another type, and truncated.
std::vector<std::string> hostile_profiles() {
  const std::string zeros(4, '\0'), one = big_endian(65536);
  const std::string colorant = "XYZ " + zeros + one + one + one;
  const auto curve = [&](uint32_t count) { return "curv" + zeros + big_endian(count) + "\1\2\3\4\5\6"; };
  const std::string parametric =
      "para" + zeros + std::string("\0\4\0\0", 4) + one + one + one + one + one + one + one;
  const auto matrix = [&](const std::string& red, const std::string& trc) {
    return profile_of("RGB ", {{"rXYZ", red},
                               {"gXYZ", colorant},
                               {"bXYZ", colorant},
                               {"rTRC", trc},
                               {"gTRC", curve(1)},
                               {"bTRC", parametric}});
  };
  const auto table = [&](const char* kind, char in, char points) {
    return kind + zeros + in + "\3" + points + std::string(37, '\0') + std::string("\0\2\0\2", 4) +
           std::string(200, '7');
  };
  std::vector<std::string> all = {
      matrix(colorant, curve(3)),
      matrix(colorant, curve(0xffffffff)),
      matrix(curve(2), colorant),
      profile_of("GRAY", {{"kTRC", parametric}}),
      profile_of("RGB ", {{"cicp", "cicp" + zeros + std::string("\x09\x10\0\1", 4)}}),
      profile_of("RGB ", {{"A2B0", table("mft2", 3, 2)}}),
      profile_of("RGB ", {{"A2B0", table("mft1", 3, '\xff')}}),
      profile_of("CMYK", {{"A2B0", table("mft2", 4, '\xff')}}),
      profile_of("RGB ",
                 {{"A2B0", "mAB " + zeros + std::string("\3\3\0\0", 4) + big_endian(32) + big_endian(0) +
                               big_endian(32) + big_endian(32) + big_endian(32) + parametric}}),
      profile_of("RGB ",
                 {{"D2B0", "mpet" + zeros + std::string("\0\3\0\3", 4) + big_endian(0x1000000) + zeros}}),
      profile_of("9CLR", {{"A2B0", table("mft2", 9, '\xff')}}),
  };
  all.push_back(all[0].substr(0, 180));
  // All of its tags are one, and lie in the table of tags.
  std::string odd = all[0];
  for (size_t tag = 0; tag < 6; ++tag) odd.replace(132 + 12 * tag + 4, 4, big_endian(128));
  all.push_back(odd);
  return all;
}

// A JPEG and a PNG with each of them.
void write_profiles(const std::string& folder, const std::string& jpeg) {
  int number = 0;
  for (const std::string& profile : hostile_profiles()) {
    const auto size = static_cast<uint32_t>(profile.size());
    const std::string part = std::string("\xff\xe2", 2) + big_endian(size + 16).substr(2) +
                             std::string("ICC_PROFILE\0\1\1", 14) + profile;
    write_file(absl::StrCat(folder, "/profile_", number, ".jpg"), jpeg.substr(0, 2) + part + jpeg.substr(2));
    std::string packed(compressBound(size), '\0');
    uLongf packed_size = packed.size();
    (void)compress(reinterpret_cast<Bytef*>(packed.data()), &packed_size,
                   reinterpret_cast<const Bytef*>(profile.data()), size);
    const std::string iccp = chunk("iCCP", std::string("p\0\0", 3) + packed.substr(0, packed_size));
    write_file(absl::StrCat(folder, "/profile_", number++, ".png"), png_of(1, 8, 2, "abc", iccp));
  }
}

// A picture turned by Exif, with a map of half its size.
void write_jpeg(const std::string& folder) {
  const std::vector<std::byte> codes(size_t{4} * 16 * 16, std::byte{90});
  const auto jpeg = [&codes](const JpegOptions& options) {
    std::string file;
    (void)encode_jpeg({.width = 16, .height = 16, .rows = codes.data(), .row_stride_bytes = 64}, options,
                      [&file](const void* bytes, size_t count) {
                        file.append(static_cast<const char*>(bytes), count);
                        return true;
                      });
    return file;
  };
  const std::string unnamed = jpeg({.transfer = EncodedTransfer::kUnknown});
  write_profiles(folder, unnamed);
  std::string base = jpeg({});
  base.insert(2, jpeg_segment('\xe1', std::string("Exif\0\0", 6) + kTurned));
  write_file(folder + "/plain.jpg", base);
  write_file(folder + "/no_end.jpg", base.substr(0, base.size() - 2));
  for (const bool one_channel : {true, false}) {
    const std::vector<uint8_t> gains(size_t{8} * 8 * (one_channel ? 1 : 3), 90);
    const GainMapMetadata metadata{.max_log2 = {2, 2, 2}, .headroom_hdr_log2 = 2, .one_channel = one_channel};
    const std::string map = *encode_gain_map(gains, 8, 8, one_channel);
    write_file(folder + (one_channel ? "/gain_map.jpg" : "/gain_maps.jpg"),
               *join_gain_map(base, map, metadata));
    if (one_channel) {
      write_apple(folder, unnamed, map);
      write_words_of_the_picture(folder, unnamed, map);
    }
  }
}

// Of each way to store samples one.
void write_tiff(const std::string& folder) {
  struct Kind {
    const char* name;
    const char* mode;
    uint16_t bits, samples, format, photometric, planes, compression;
    bool tiled;
  };
  constexpr uint16_t kUint = SAMPLEFORMAT_UINT, kFloat = SAMPLEFORMAT_IEEEFP;
  constexpr uint16_t kTogether = PLANARCONFIG_CONTIG, kApart = PLANARCONFIG_SEPARATE;
  for (const Kind& kind :
       {Kind{"plain", "wl", 8, 3, kUint, PHOTOMETRIC_RGB, kTogether, COMPRESSION_NONE, false},
        Kind{"tiles", "wb", 16, 4, kUint, PHOTOMETRIC_RGB, kApart, COMPRESSION_LZW, true},
        Kind{"floats", "wl8", 32, 3, kFloat, PHOTOMETRIC_RGB, kTogether, COMPRESSION_ADOBE_DEFLATE, false},
        Kind{"halves", "wl", 16, 1, kFloat, PHOTOMETRIC_MINISBLACK, kTogether, COMPRESSION_ZSTD, true},
        Kind{"palette", "wl", 4, 1, kUint, PHOTOMETRIC_PALETTE, kTogether, COMPRESSION_PACKBITS, false},
        Kind{"inks", "wl", 8, 5, kUint, PHOTOMETRIC_SEPARATED, kTogether, COMPRESSION_LZW, false},
        Kind{"webp", "wl", 8, 3, kUint, PHOTOMETRIC_RGB, kTogether, COMPRESSION_WEBP, false},
        Kind{"fax", "wl", 1, 1, kUint, PHOTOMETRIC_MINISWHITE, kTogether, COMPRESSION_CCITTFAX4, false},
        Kind{"jpeg", "wl", 8, 3, kUint, PHOTOMETRIC_YCBCR, kTogether, COMPRESSION_JPEG, true},
        Kind{"log", "wl", 32, 3, kFloat, PHOTOMETRIC_LOGLUV, kTogether, COMPRESSION_SGILOG, false},
        Kind{"ycbcr", "wl", 8, 3, kUint, PHOTOMETRIC_YCBCR, kTogether, COMPRESSION_NONE, false}}) {
    TIFF* const tiff = TIFFOpen(absl::StrCat(folder, "/", kind.name, ".tif").c_str(), kind.mode);
    TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, 20);
    TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, 12);
    TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, kind.samples);
    TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, kind.photometric);
    TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, kind.planes);
    TIFFSetField(tiff, TIFFTAG_COMPRESSION, kind.compression);
    TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, kind.bits);
    TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, kind.format);
    TIFFSetField(tiff, TIFFTAG_ORIENTATION, ORIENTATION_RIGHTTOP);
    const std::vector<uint16_t> colors(16, 40000), alpha = {EXTRASAMPLE_ASSOCALPHA};
    if (kind.photometric == PHOTOMETRIC_PALETTE) {
      TIFFSetField(tiff, TIFFTAG_COLORMAP, colors.data(), colors.data(), colors.data());
    }
    if (kind.samples > 3) TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, alpha.data());
    if (kind.compression == COMPRESSION_SGILOG) {
      TIFFSetField(tiff, TIFFTAG_SGILOGDATAFMT, SGILOGDATAFMT_FLOAT);
    }
    if (kind.tiled) {
      TIFFSetField(tiff, TIFFTAG_TILEWIDTH, 16);
      TIFFSetField(tiff, TIFFTAG_TILELENGTH, 16);
    } else {
      TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 4);
    }
    std::vector<uint8_t> codes(static_cast<size_t>(kind.tiled ? TIFFTileSize(tiff) : TIFFStripSize(tiff)),
                               60);
    const uint32_t pieces = kind.tiled ? TIFFNumberOfTiles(tiff) : TIFFNumberOfStrips(tiff);
    const auto bytes = static_cast<tmsize_t>(codes.size());
    for (uint32_t i = 0; i < pieces; ++i) {
      (void)(kind.tiled ? TIFFWriteEncodedTile : TIFFWriteEncodedStrip)(tiff, i, codes.data(), bytes);
    }
    TIFFClose(tiff);
  }
  Image image = *make_image(5, 3, ImageFormat::kRgba16);
  (void)write_image(folder + "/profile.tif", image);
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
  write_tiff(folder);
}

namespace {

// Seeds of the wire target: calls of each kind.

std::string band(uint32_t first_row, size_t bytes) {
  v1::RenderRequest message;
  message.mutable_band()->set_first_row(first_row);
  message.mutable_band()->set_pixels(std::string(bytes, 'p'));
  return message.SerializeAsString();
}

std::string zstd_band(uint32_t first_row, uint32_t rows, v1::PixelFormat format) {
  const std::vector<std::byte> pixels(size_t{rows} * 3 * bytes_per_pixel(format), std::byte{'p'});
  v1::RowPacker packer;
  const grpc::Slice packed = packer.pack(pixels, 3, format);
  v1::RenderRequest message;
  message.mutable_band()->set_first_row(first_row);
  message.mutable_band()->set_zstd(packed.begin(), packed.size());
  return message.SerializeAsString();
}

// Every field except those that conflict with others, so that the fuzzer knows them all.
void set_all(v1::Settings& settings) {
  v1::Exposure& exposure = *settings.mutable_exposure();
  exposure.set_mode(v1::Exposure::MODE_MANUAL);
  exposure.set_manual_ev(-2);
  exposure.set_compensation_ev(1);
  exposure.set_key(0.2);
  exposure.set_min_exposure(0.5);
  exposure.set_max_exposure(2);
  v1::Metering& metering = *exposure.mutable_metering();
  metering.set_statistic(v1::Metering::STATISTIC_PERCENTILE);
  metering.set_percentile_low(5);
  metering.set_percentile_high(95);
  metering.set_weights(v1::Metering::WEIGHTS_SPOT);
  metering.mutable_spot()->set_x0(1);
  metering.mutable_spot()->set_x1(2);
  metering.mutable_spot()->set_y0(1);
  metering.mutable_spot()->set_y1(3);
  v1::Adaptation& adaptation = *exposure.mutable_adaptation();
  adaptation.set_domain(v1::Adaptation::DOMAIN_LINEAR);
  adaptation.set_speed_up(2);
  adaptation.set_speed_down(0.5);
  v1::Bloom& bloom = *settings.mutable_bloom();
  bloom.set_intensity(0.1f);
  bloom.set_threshold(2);
  bloom.set_softness(0.25f);
  bloom.set_levels(3);
  bloom.set_firefly_weights(false);
  bloom.set_kind(v1::Bloom::KIND_GAUSSIAN);
  settings.set_curve(v1::TONE_CURVE_REINHARD_EXTENDED);
  settings.set_curve_white(8);
  settings.set_prescale(1.5);
  settings.set_transfer(v1::TRANSFER_GAMMA22);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  settings.set_bad_values(v1::BAD_VALUES_REJECT);
  settings.set_tier("standard");
  settings.set_dither(true);
  v1::Chromaticities& xy = *settings.mutable_input_chromaticities();
  xy.set_red_x(0.7f);
  xy.set_red_y(0.3f);
  xy.set_green_x(0.2f);
  xy.set_green_y(0.7f);
  xy.set_blue_x(0.1f);
  xy.set_blue_y(0.1f);
  xy.set_white_x(0.31f);
  xy.set_white_y(0.33f);
}

// A frame of 3 x 4 pixels in two bands.
void write_request(const std::string& path, v1::PixelFormat format, uint32_t pixel_bytes, bool all_fields) {
  const uint32_t stride = 3 * pixel_bytes + (all_fields ? 5 : 0);
  v1::RenderRequest request;
  v1::FrameHeader& frame = *request.mutable_start()->mutable_frame();
  frame.set_width(3);
  frame.set_height(4);
  frame.set_format(format);
  if (all_fields) {
    frame.set_sequence(7);
    frame.set_row_stride_bytes(stride);
    frame.set_total_bytes(uint64_t{4} * stride);
    set_all(*request.mutable_start()->mutable_settings());
    request.mutable_start()->set_verify(true);
    request.mutable_start()->set_error_map(true);
    request.mutable_start()->mutable_previous()->set_exposure(1.5);
    request.mutable_start()->mutable_previous()->set_elapsed_seconds(0.04);
  } else {
    frame.set_exposure(kGivenExposure);
    v1::Settings& settings = *request.mutable_start()->mutable_settings();
    settings.set_max_error_codes(1);
    settings.set_input_primaries(v1::PRIMARIES_REC2020);
  }
  WireInput input;
  input.messages = {request.SerializeAsString(), band(0, size_t{3} * stride), band(3, stride)};
  write_file(path, format_wire_input(input));
  input.messages = {request.SerializeAsString(), zstd_band(0, 3, format), zstd_band(3, 1, format)};
  write_file(path + "_zstd", format_wire_input(input));
  frame.mutable_memory()->set_ticket("0123456789abcdef");
  frame.mutable_memory()->set_pixels_offset(128);
  frame.mutable_memory()->set_image_offset(4096);
  input.messages = {request.SerializeAsString()};
  write_file(path + "_in_memory", format_wire_input(input));
}

std::string map_band(uint32_t first_row, size_t bytes) {
  v1::RenderResponse message;
  message.mutable_error_map()->set_first_row(first_row);
  message.mutable_error_map()->set_pixels(std::string(bytes, 'e'));
  return message.SerializeAsString();
}

void write_response(const std::string& path, v1::OutputFormat format, uint32_t pixel_bytes, bool error_map) {
  v1::RenderResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header.set_sequence(7);
  header.set_width(3);
  header.set_height(4);
  header.set_format(format);
  header.mutable_statistics()->set_mean_log2_luminance(-1);
  header.set_exposure(2);
  header.add_plan("ingest");
  header.add_stages()->set_name("queue");
  header.set_tier("standard");
  if (error_map) header.mutable_verify()->set_max_error_codes(0.5);
  WireInput input{.reader = WireInput::Reader::kClient,
                  .error_map = error_map,
                  .slice_bytes = 5,
                  .width = 3,
                  .height = 4};
  input.messages = {response.SerializeAsString(), band(0, size_t{9} * pixel_bytes),
                    band(3, size_t{3} * pixel_bytes)};
  if (error_map) {
    input.messages.push_back(map_band(0, 18));
    input.messages.push_back(map_band(3, 6));
  }
  write_file(path, format_wire_input(input));
}

v1::StreamResponse stream_header(uint64_t sequence, uint64_t encoded_bytes) {
  v1::StreamResponse response;
  v1::ResultHeader& header = *response.mutable_header();
  header.set_sequence(sequence);
  header.set_width(3);
  header.set_height(4);
  header.set_format(v1::OUTPUT_FORMAT_RGBA16);
  header.set_resume_token("token");
  header.set_encoded_bytes(encoded_bytes);
  return response;
}

// A session's three results: an image in bands, an image as a file, and a failure. Then the connection ends.
void write_session(const std::string& path, bool alpha_left_out) {
  WireInput input{.reader = WireInput::Reader::kSession, .slice_bytes = 7, .width = 3, .height = 4};
  v1::StreamResponse opened, part, failure, away;
  opened.mutable_opened()->set_session("fuzz");
  opened.mutable_opened()->set_max_frames_in_flight(2);
  part.mutable_encoded()->set_data("file!");
  failure.mutable_failure()->set_sequence(2);
  failure.mutable_failure()->set_code(4);
  failure.mutable_failure()->set_message("late");
  failure.mutable_failure()->set_resume_token("token");
  away.mutable_go_away()->set_reason("draining");
  v1::StreamResponse image = stream_header(0, 0);
  image.mutable_header()->set_alpha_left_out(alpha_left_out);
  const size_t row = alpha_left_out ? 18 : 24;
  input.messages = {opened.SerializeAsString(), image.SerializeAsString(), band(0, 3 * row), band(3, row)};
  for (const v1::StreamResponse& message : {stream_header(1, 10), part, part, failure, away}) {
    input.messages.push_back(message.SerializeAsString());
  }
  write_file(path, format_wire_input(input));
}

// A session without images: every result is a header with a state.
void write_metered_session(const std::string& path) {
  WireInput input{.reader = WireInput::Reader::kSession, .metered = true, .width = 3, .height = 4};
  v1::StreamResponse message;
  message.mutable_opened()->set_session("fuzz");
  input.messages = {message.SerializeAsString()};
  for (uint64_t i = 0; i < kSessionFrames; ++i) {
    message = stream_header(i, 0);
    message.mutable_header()->set_encoding(v1::ENCODING_NONE);
    message.mutable_header()->set_exposure(kGivenExposure);
    message.mutable_header()->mutable_state()->set_sequence(i);
    input.messages.push_back(message.SerializeAsString());
  }
  write_file(path, format_wire_input(input));
}

// The open message of a session that continues after a state.
void write_open_with_state(const std::string& path) {
  v1::StreamRequest request;
  v1::StreamOpen& open = *request.mutable_open();
  open.set_session("fuzz");
  open.set_cut_threshold_ev(1);
  open.set_encoding(v1::ENCODING_NONE);
  open.set_return_state(true);
  open.mutable_state()->set_sequence(7);
  open.mutable_state()->set_media_time_ns(291666667);
  open.mutable_state()->set_exposure(0.3);
  open.mutable_state()->set_target(0.25);
  open.mutable_state()->set_cut_pending(true);
  for (int i = 0; i < 64; ++i) open.mutable_state()->add_picture(static_cast<float>(i) / 8);
  WireInput input;
  input.messages = {request.SerializeAsString()};
  write_file(path, format_wire_input(input));
}

// A panorama of 4 x 2 pixels, a bake of it, and a view with a sphere.
void write_environment(const std::string& folder) {
  v1::PutEnvironmentRequest put;
  v1::EnvironmentStart& start = *put.mutable_start();
  start.set_width(4);
  start.set_height(2);
  start.set_format(v1::PIXEL_FORMAT_RGB9E5);
  start.set_input_primaries(v1::PRIMARIES_REC2020);
  start.set_bad_values(v1::BAD_VALUES_REJECT);
  WireInput input;
  input.messages = {put.SerializeAsString(), band(0, 16), band(1, 16)};
  write_file(folder + "/put_environment", format_wire_input(input));

  v1::BakeEnvironmentRequest bake;
  bake.set_id(std::string(64, 'a'));
  bake.set_size(32);
  bake.set_levels(1);
  bake.set_roughness_mapping(v1::ROUGHNESS_MAPPING_PERCEPTUAL);
  bake.set_rotation_deg(90);
  bake.set_format(v1::PIXEL_FORMAT_RGBA16F);
  bake.set_tier("draft");
  input.messages = {bake.SerializeAsString()};
  write_file(folder + "/bake", format_wire_input(input));

  v1::RenderRequest render;
  v1::FrameHeader& frame = *render.mutable_start()->mutable_frame();
  frame.set_width(3);
  frame.set_height(4);
  v1::View& view = *frame.mutable_view();
  view.set_environment(std::string(64, 'a'));
  view.set_rotation_deg(10);
  view.set_samples(16);
  view.mutable_camera()->set_fov_deg(90);
  view.mutable_camera()->mutable_orientation()->set_w(1);
  view.mutable_camera()->mutable_position()->set_z(5);
  v1::Sphere& sphere = *view.add_objects();
  sphere.mutable_centre()->set_x(2);
  sphere.set_radius(0.5);
  sphere.mutable_base_color()->set_y(0.5);
  sphere.set_metallic(1);
  sphere.set_roughness(0.25);
  sphere.set_fixed_to_camera(true);
  input.messages = {render.SerializeAsString()};
  write_file(folder + "/view", format_wire_input(input));
}

}  // namespace

void write_wire_seeds(const std::string& folder) {
  for (const bool all_fields : {false, true}) {
    const std::string path = folder + (all_fields ? "/all_" : "/plain_");
    write_request(path + "rgba16f", v1::PIXEL_FORMAT_RGBA16F, 8, all_fields);
    write_request(path + "rgba32f", v1::PIXEL_FORMAT_RGBA32F, 16, all_fields);
    write_request(path + "rgb9e5", v1::PIXEL_FORMAT_RGB9E5, 4, all_fields);
    write_request(path + "rgb16f", v1::PIXEL_FORMAT_RGB16F, 6, all_fields);
    write_request(path + "rgb32f", v1::PIXEL_FORMAT_RGB32F, 12, all_fields);
  }
  write_response(folder + "/response_rgba8", v1::OUTPUT_FORMAT_RGBA8, 4, false);
  write_response(folder + "/response_rgba16", v1::OUTPUT_FORMAT_RGBA16, 8, false);
  write_response(folder + "/response_rgba16f", v1::OUTPUT_FORMAT_RGBA16F, 8, true);
  write_session(folder + "/session", false);
  write_session(folder + "/session_without_alpha", true);
  write_metered_session(folder + "/metered_session");
  write_open_with_state(folder + "/open_with_state");
  write_environment(folder);
}

}  // namespace candela

// Writes the fuzzers' seeds: `fuzz_seeds FOLDER` makes FOLDER/image and FOLDER/wire.

int main(int count, char** arguments) {
  if (count != 2) return 2;
  const std::string image = std::string(arguments[1]) + "/image", wire = std::string(arguments[1]) + "/wire";
  std::filesystem::create_directories(image);
  std::filesystem::create_directories(wire);
  candela::write_image_seeds(image);
  candela::write_wire_seeds(wire);
}
