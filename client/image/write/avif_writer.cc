// Writes AVIF by libavif and libaom: 10 bits, 4:4:4, full range, with alpha if the image has it. Code points
// say its primaries, transfer and matrix. This libavif writes no light levels (clli, mdcv).
#include <avif/avif.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <thread>

#include "absl/strings/str_cat.h"
#include "client/image/write/writers.h"
#include "server/encode/color_words.h"

namespace candela {
namespace {

constexpr int kBits = 10;
constexpr int kSpeed = 6;  // of 0 .. 10, the slowest first
// With one thread libaom codes the rows in another way. Two or more make the same bytes.
constexpr int kLeastThreads = 2;

struct DestroyAvif {
  void operator()(avifImage* image) const { avifImageDestroy(image); }
  void operator()(avifEncoder* encoder) const { avifEncoderDestroy(encoder); }
};
using AvifPicture = std::unique_ptr<avifImage, DestroyAvif>;
struct EncodedAvif {
  avifRWData bytes = AVIF_DATA_EMPTY;
  EncodedAvif() = default;
  EncodedAvif(const EncodedAvif&) = delete;
  ~EncodedAvif() { avifRWDataFree(&bytes); }
};

absl::Status failed_avif(avifResult result, const char* detail = "") {
  return absl::InternalError(absl::StrCat("cannot encode the AVIF: ", avifResultToString(result),
                                          *detail == '\0' ? "" : ": ", detail));
}

void say_colours(const Image& image, const WriteOptions& options, avifImage& picture) {
  const CodePoints code = code_points(options.transfer, options.hdr);
  picture.colorPrimaries = code.primaries;
  picture.transferCharacteristics = code.transfer;
  picture.matrixCoefficients = code.matrix;
  if (const std::string profile = profile_of_primaries(options); !profile.empty()) {
    picture.colorPrimaries = AVIF_COLOR_PRIMARIES_UNSPECIFIED;
    picture.transferCharacteristics = AVIF_TRANSFER_CHARACTERISTICS_UNSPECIFIED;
    avifImageSetProfileICC(&picture, reinterpret_cast<const uint8_t*>(profile.data()), profile.size());
  }
  picture.yuvRange = AVIF_RANGE_FULL;
  picture.alphaPremultiplied = options.associated_alpha ? AVIF_TRUE : AVIF_FALSE;
  const AspectRatio aspect = aspect_ratio(image.pixel_aspect);
  if (aspect.width == aspect.height) return;
  picture.transformFlags |= AVIF_TRANSFORM_PASP;
  picture.pasp = {.hSpacing = aspect.width, .vSpacing = aspect.height};
}

// Makes the planes of Y, Cb, Cr and alpha.
avifResult fill_planes(const Image& image, avifImage& picture) {
  avifRGBImage rgb;
  avifRGBImageSetDefaults(&rgb, &picture);
  rgb.depth = 16;
  rgb.format = AVIF_RGB_FORMAT_RGBA;
  rgb.ignoreAlpha = image.has_alpha ? AVIF_FALSE : AVIF_TRUE;
  rgb.alphaPremultiplied = picture.alphaPremultiplied;  // alpha stays as it is
  // libavif only reads them.
  rgb.pixels = const_cast<uint8_t*>(reinterpret_cast<const uint8_t*>(image.pixels.data()));
  rgb.rowBytes = static_cast<uint32_t>(image.row_bytes());
  return avifImageRGBToYUV(&picture, &rgb);
}

}  // namespace

absl::Status encode_avif(const Image& image, const WriteOptions& options, int threads, ByteSink sink) {
  const AvifPicture picture(avifImageCreate(image.width, image.height, kBits, AVIF_PIXEL_FORMAT_YUV444));
  const std::unique_ptr<avifEncoder, DestroyAvif> encoder(avifEncoderCreate());
  if (picture == nullptr || encoder == nullptr) return failed_avif(AVIF_RESULT_OUT_OF_MEMORY);
  say_colours(image, options, *picture);
  if (const avifResult result = fill_planes(image, *picture); result != AVIF_RESULT_OK) {
    return failed_avif(result);
  }
  encoder->codecChoice = AVIF_CODEC_CHOICE_AOM;
  encoder->speed = kSpeed;
  encoder->maxThreads = std::max(kLeastThreads, threads);
  encoder->minQuantizer = encoder->maxQuantizer =
      static_cast<int>(std::lround((100 - options.jpeg_quality) * AVIF_QUANTIZER_WORST_QUALITY / 100.0));
  EncodedAvif encoded;
  const avifResult result = avifEncoderWrite(encoder.get(), picture.get(), &encoded.bytes);
  if (result != AVIF_RESULT_OK) return failed_avif(result, encoder->diag.error);
  if (sink(encoded.bytes.data, encoded.bytes.size)) return absl::OkStatus();
  return absl::InternalError("cannot encode the AVIF: write failed");
}

absl::Status write_avif(AtomicFile& file, const Image& image, const WriteOptions& options, Notes&) {
  // A sequence's pictures are written side by side.
  constexpr uint32_t kMostThreads = 16;
  const auto threads = static_cast<int>(std::min(kMostThreads, std::thread::hardware_concurrency()));
  return encode_avif(image, options, threads,
                     [&file](const void* bytes, size_t count) { return file.write(bytes, count); });
}

}  // namespace candela
