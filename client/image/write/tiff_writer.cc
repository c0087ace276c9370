// Writes TIFF: 8 bits from kRgba8, 16 from kRgba16, with alpha if the image has it. It is compressed by
// Deflate with horizontal differences, which loses nothing. An ICC profile says its primaries and transfer.
#include <tiffio.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <memory>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/image/write/writers.h"
#include "server/encode/picture.h"

namespace candela {
namespace {

// The file that libtiff writes, and the first error that it reports.
struct TiffOutput {
  AtomicFile& file;
  uint64_t size = 0;
  char error[200] = "";
};

TiffOutput& output_of(thandle_t handle) { return *static_cast<TiffOutput*>(handle); }

tmsize_t tiff_write(thandle_t handle, void* bytes, tmsize_t count) {
  TiffOutput& output = output_of(handle);
  if (!output.file.write(bytes, static_cast<size_t>(count))) return 0;
  output.size = std::max(output.size, output.file.position());
  return count;
}

tmsize_t tiff_read(thandle_t, void*, tmsize_t) { return 0; }  // a new file has nothing to read

toff_t tiff_seek(thandle_t handle, toff_t offset, int from) {
  TiffOutput& output = output_of(handle);
  const uint64_t base = from == SEEK_SET ? 0 : from == SEEK_CUR ? output.file.position() : output.size;
  return output.file.seek(base + offset) ? base + offset : static_cast<toff_t>(-1);
}

int tiff_close(thandle_t) { return 0; }

toff_t tiff_size(thandle_t handle) { return output_of(handle).size; }

int tiff_error(TIFF*, void* handle, const char*, const char* format, va_list arguments) {
  TiffOutput& output = output_of(handle);
  if (output.error[0] == '\0') std::vsnprintf(output.error, sizeof output.error, format, arguments);
  return 1;  // libtiff prints nothing
}

int tiff_warning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

using Tiff = std::unique_ptr<TIFF, decltype(&TIFFClose)>;

Tiff open_tiff(TiffOutput& output) {
  const std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)> options(TIFFOpenOptionsAlloc(),
                                                                                 &TIFFOpenOptionsFree);
  if (options == nullptr) return {nullptr, &TIFFClose};
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), tiff_error, &output);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), tiff_warning, nullptr);
  return {TIFFClientOpenExt(output.file.path().c_str(), "wl", &output, tiff_read, tiff_write, tiff_seek,
                            tiff_close, tiff_size, nullptr, nullptr, options.get()),
          &TIFFClose};
}

bool set_fields(TIFF* tiff, const Image& image, const WriteOptions& options, uint32_t strip_rows) {
  constexpr int kFast = 1;  // of Deflate's levels, 1 .. 12
  const AspectRatio aspect = aspect_ratio(image.pixel_aspect);
  const std::string own = profile_of_primaries(options);
  const std::string& profile = own.empty() ? icc_profile(options.transfer) : own;
  const uint16_t alpha = options.associated_alpha ? EXTRASAMPLE_ASSOCALPHA : EXTRASAMPLE_UNASSALPHA;
  return TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, image.width) != 0 &&
         TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, image.height) != 0 &&
         TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, image.format == ImageFormat::kRgba16 ? 16 : 8) != 0 &&
         TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, image.has_alpha ? 4 : 3) != 0 &&
         (!image.has_alpha || TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, &alpha) != 0) &&
         TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_RGB) != 0 &&
         TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) != 0 &&
         TIFFSetField(tiff, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT) != 0 &&
         TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, strip_rows) != 0 &&
         TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_ADOBE_DEFLATE) != 0 &&
         TIFFSetField(tiff, TIFFTAG_PREDICTOR, PREDICTOR_HORIZONTAL) != 0 &&
         TIFFSetField(tiff, TIFFTAG_ZIPQUALITY, kFast) != 0 &&
         // Pixels per unit, where the unit has no size. Wider pixels mean fewer of them.
         TIFFSetField(tiff, TIFFTAG_RESOLUTIONUNIT, RESUNIT_NONE) != 0 &&
         TIFFSetField(tiff, TIFFTAG_XRESOLUTION, static_cast<double>(aspect.height)) != 0 &&
         TIFFSetField(tiff, TIFFTAG_YRESOLUTION, static_cast<double>(aspect.width)) != 0 &&
         (profile.empty() ||
          TIFFSetField(tiff, TIFFTAG_ICCPROFILE, static_cast<uint32_t>(profile.size()), profile.data()) != 0);
}

bool write_strips(TIFF* tiff, const Image& image, uint32_t strip_rows) {
  const size_t pixel = bytes_per_pixel(image.format), kept = image.has_alpha ? pixel : pixel / 4 * 3;
  std::vector<std::byte> strip(size_t{strip_rows} * image.width * kept);
  for (uint32_t y = 0; y < image.height; y += strip_rows) {
    const std::byte* from = image.pixels.data() + y * image.row_bytes();
    const size_t pixels = size_t{std::min(strip_rows, image.height - y)} * image.width;
    for (size_t i = 0; i < pixels; ++i) std::memcpy(&strip[i * kept], from + i * pixel, kept);
    const auto bytes = static_cast<tmsize_t>(pixels * kept);
    if (TIFFWriteEncodedStrip(tiff, y / strip_rows, strip.data(), bytes) != bytes) return false;
  }
  return true;
}

}  // namespace

absl::Status write_tiff(AtomicFile& file, const Image& image, const WriteOptions& options, Notes&) {
  constexpr uint64_t kStripBytes = 512 << 10;
  const auto strip_rows =
      static_cast<uint32_t>(std::clamp<uint64_t>(kStripBytes / image.row_bytes(), 1, image.height));
  TiffOutput output{file};
  Tiff tiff = open_tiff(output);
  const bool written = tiff != nullptr && set_fields(tiff.get(), image, options, strip_rows) &&
                       write_strips(tiff.get(), image, strip_rows) && TIFFWriteDirectory(tiff.get()) != 0;
  tiff.reset();  // it may write
  if (written && output.error[0] == '\0') return absl::OkStatus();
  return absl::InternalError(
      absl::StrCat("cannot encode the TIFF: ", output.error[0] != '\0' ? output.error : "no memory"));
}

}  // namespace candela
