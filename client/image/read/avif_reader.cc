// Reads AVIF files by libavif: the first picture, of 8, 10 or 12 bits, cropped (clap) and upright. Gain maps
// are not used; a note says so.
#include <avif/avif.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/image/read/icc_profile.h"
#include "client/image/read/readers.h"
#include "client/image/read/signal.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

struct Destroy {
  void operator()(avifDecoder* decoder) const { avifDecoderDestroy(decoder); }
};
struct FreeRgb {
  avifRGBImage* image;
  ~FreeRgb() { avifRGBImageFreePixels(image); }
};

absl::Status damaged_avif(const FileReader& file, avifResult result, const avifDecoder& decoder) {
  const std::string detail = printable(decoder.diag.error, 100);
  return absl::InvalidArgumentError(absl::StrFormat("%s: damaged AVIF file: %s%s", file.path(),
                                                    avifResultToString(result),
                                                    detail.empty() ? "" : " (" + detail + ")"));
}

absl::Status unread_matrix(const FileReader& file, const avifImage& picture) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: its luma and chroma have matrix %d of H.273 in %s planes, which cannot be read; name "
      "another one with --input-matrix",
      file.path(), picture.matrixCoefficients, avifPixelFormatToString(picture.yuvFormat)));
}

// Turns a picture upright, as the file asks: first counterclockwise by quarter turns, then mirrored.
class Upright {
 public:
  Upright(const avifImage& image, const avifCropRect& crop)
      : width_(crop.width),
        height_(crop.height),
        turns_((image.transformFlags & AVIF_TRANSFORM_IROT) != 0 ? image.irot.angle & 3 : 0),
        mirror_((image.transformFlags & AVIF_TRANSFORM_IMIR) != 0 ? image.imir.mode : -1) {}

  bool is_needed() const { return turns_ != 0 || mirror_ >= 0; }
  uint32_t width() const { return turns_ % 2 == 1 ? height_ : width_; }
  uint32_t height() const { return turns_ % 2 == 1 ? width_ : height_; }
  std::array<uint32_t, 2> place(uint32_t x, uint32_t y) const {
    const uint32_t right = width_ - 1 - x, up = height_ - 1 - y;
    std::array<uint32_t, 2> at = turns_ == 0   ? std::array{x, y}
                                 : turns_ == 1 ? std::array{y, right}
                                 : turns_ == 2 ? std::array{right, up}
                                               : std::array{up, x};
    if (mirror_ == 0) at[1] = height() - 1 - at[1];  // top and bottom change places
    if (mirror_ == 1) at[0] = width() - 1 - at[0];
    return at;
  }

 private:
  uint32_t width_, height_;
  int turns_, mirror_;
};

// The part of the coded picture that is to be seen. All of it, with a note, if the file's part is none.
avifCropRect crop_of(const avifImage& image, std::vector<std::string>& notes) {
  avifCropRect crop{0, 0, image.width, image.height};
  if ((image.transformFlags & AVIF_TRANSFORM_CLAP) == 0) return crop;
  avifDiagnostics why;
  avifDiagnosticsClearError(&why);
  if (avifCropRectConvertCleanApertureBox(&crop, &image.clap, image.width, image.height, image.yuvFormat,
                                          &why)) {
    return crop;
  }
  notes.push_back(absl::StrFormat("its cropping is not applied: %s", printable(why.error, 100)));
  return {0, 0, image.width, image.height};
}

// A profile counts before the code points, as libavif says, but for the signals of HDR displays, which a
// profile can only come close to.
absl::StatusOr<Signal> signal_of_avif(const FileReader& file, const avifImage& image,
                                      const PictureChoice& choice, std::vector<std::string>& notes) {
  Signal signal;
  const bool hdr = image.transferCharacteristics == AVIF_TRANSFER_CHARACTERISTICS_SMPTE2084 ||
                   image.transferCharacteristics == AVIF_TRANSFER_CHARACTERISTICS_HLG;
  const bool names_primaries = image.colorPrimaries != AVIF_COLOR_PRIMARIES_UNSPECIFIED;
  if (image.icc.size > 0 && (!hdr || !names_primaries)) {
    take_profile("ICC", {reinterpret_cast<const char*>(image.icc.data), image.icc.size},
                 image.yuvFormat == AVIF_PIXEL_FORMAT_YUV400 ? 1 : 3, signal, notes);
    if (!hdr && !signal.source.empty()) return signal;
  } else if (image.icc.size > 0) {
    notes.push_back("the file's ICC profile is not used: its code points count");
  }
  const bool names_transfer = image.transferCharacteristics != AVIF_TRANSFER_CHARACTERISTICS_UNSPECIFIED;
  if (!names_primaries && !names_transfer) return signal;
  RETURN_IF_ERROR(set_code_points(file.path(), "nclx", image.colorPrimaries, image.transferCharacteristics,
                                  choice, signal));
  return signal;
}

// The luma of H.273's numbers 3 and above 14 has no meaning, and libavif takes it as BT.601.
absl::Status take_planes_choice(const FileReader& file, const PictureChoice& choice, avifImage& picture) {
  if (choice.matrix) picture.matrixCoefficients = static_cast<avifMatrixCoefficients>(*choice.matrix);
  if (choice.full_range) picture.yuvRange = *choice.full_range ? AVIF_RANGE_FULL : AVIF_RANGE_LIMITED;
  if (picture.matrixCoefficients != 3 && picture.matrixCoefficients <= AVIF_MATRIX_COEFFICIENTS_ICTCP) {
    return absl::OkStatus();
  }
  return unread_matrix(file, picture);
}

// True if the file has a gain map. This libavif does not look for one. ISO 21496-1 marks it by a brand, Apple
// by a kind of auxiliary picture.
bool has_gain_map(absl::string_view file) {
  while (file.size() >= 8) {
    const size_t size = big_endian_at(file, 0);
    const absl::string_view kind = file.substr(4, 4);
    if (size < 8 || size > file.size()) return false;  // the pixels, to the end of the file or of 64 bits
    for (size_t at = 8; kind == "ftyp" && at + 4 <= size; at += 4) {
      if (file.substr(at, 4) == "tmap") return true;
    }
    if (kind == "meta" && absl::StrContains(file.substr(0, size), ":hdrgainmap")) return true;
    file.remove_prefix(size);
  }
  return false;
}

// This libavif does not read these boxes, of 12 and of 32 bytes. Source: ISO/IEC 14496-12.
double max_light_of(absl::string_view file) {
  constexpr absl::string_view kOfPixels(
      "\0\0\0\x0c"
      "clli",
      8);
  constexpr absl::string_view kOfDisplay(
      "\0\0\0\x20"
      "mdcv",
      8);
  constexpr size_t kMasteringAt = 16;  // behind the display's primaries and white
  constexpr double kUnit = 1e-4;
  double pixels = 0, display = 0;
  if (const size_t at = file.find(kOfPixels); at != file.npos) {
    pixels = big_endian_at(file, at + kOfPixels.size(), 2);
  }
  if (const size_t at = file.find(kOfDisplay); at != file.npos) {
    display = kUnit * big_endian_at(file, at + kOfDisplay.size() + kMasteringAt);
  }
  return max_light(pixels, display);
}

// The width of an upright pixel over its height; nothing if the file does not say it.
std::optional<double> pixel_aspect_of(const avifImage& image) {
  if ((image.transformFlags & AVIF_TRANSFORM_PASP) == 0) return std::nullopt;
  const double across = image.pasp.hSpacing, down = image.pasp.vSpacing;
  const bool on_its_side = (image.transformFlags & AVIF_TRANSFORM_IROT) != 0 && image.irot.angle % 2 == 1;
  return on_its_side ? down / across : across / down;
}

}  // namespace

absl::StatusOr<Image> read_avif(FileReader& file, const ImageLimits& limits, const PictureChoice& choice) {
  if (file.remaining() > limits.max_bytes) {
    return absl::ResourceExhaustedError(absl::StrFormat("%s: the file has %d bytes; the limit is %d",
                                                        file.path(), file.remaining(), limits.max_bytes));
  }
  std::vector<std::byte> bytes(file.remaining());
  if (!file.read(bytes)) return file.truncated("its end");
  const std::unique_ptr<avifDecoder, Destroy> decoder(avifDecoderCreate());
  if (!decoder) return absl::ResourceExhaustedError(file.path() + ": not enough memory to decode it");
  // As browsers do.
  decoder->strictFlags = AVIF_STRICT_ENABLED & ~(AVIF_STRICT_PIXI_REQUIRED | AVIF_STRICT_CLAP_VALID);
  decoder->ignoreExif = decoder->ignoreXMP = AVIF_TRUE;
  decoder->maxThreads = 2;
  avifResult result =
      avifDecoderSetIOMemory(decoder.get(), reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size());
  if (result == AVIF_RESULT_OK) result = avifDecoderParse(decoder.get());
  if (result != AVIF_RESULT_OK) return damaged_avif(file, result, *decoder);
  avifImage& picture = *decoder->image;
  // What is cropped away takes memory, too.
  constexpr ImageFormat kFormat = ImageFormat::kRgba32f;
  RETURN_IF_ERROR(check_image_size(file.path(), "image", picture.width, picture.height, kFormat, limits));
  std::vector<std::string> notes;
  const avifCropRect crop = crop_of(picture, notes);
  const Upright upright(picture, crop);
  ASSIGN_OR_RETURN(Signal signal, signal_of_avif(file, picture, choice, notes));
  signal.max_light_nits = max_light_of({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  if (decoder->imageCount > 1) {
    notes.push_back(absl::StrFormat("the first of its %d pictures is shown", decoder->imageCount));
  }
  const bool maps = has_gain_map({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  if (maps && !choice.base_of_gain_map) {
    notes.push_back("its gain map is not used: the picture without it is shown");
  }
  ASSIGN_OR_RETURN(Image image, make_image(upright.width(), upright.height(), kFormat));
  // The coded picture says its size again, and memory is taken for that.
  decoder->imageSizeLimit = picture.width * picture.height;
  if (result = avifDecoderNextImage(decoder.get()); result != AVIF_RESULT_OK) {
    return damaged_avif(file, result, *decoder);
  }
  RETURN_IF_ERROR(take_planes_choice(file, choice, picture));
  avifRGBImage rgb;
  avifRGBImageSetDefaults(&rgb, &picture);
  rgb.depth = 16;
  rgb.format = AVIF_RGB_FORMAT_RGBA;
  rgb.alphaPremultiplied = AVIF_FALSE;
  avifRGBImageAllocatePixels(&rgb);
  const FreeRgb free{&rgb};
  if (avifImageYUVToRGB(&picture, &rgb) != AVIF_RESULT_OK) return unread_matrix(file, picture);

  image.has_alpha = picture.alphaPlane != nullptr;
  image.has_gain_map = maps;
  image.notes = std::move(notes);
  if (const std::optional<double> aspect = pixel_aspect_of(picture)) set_pixel_aspect(*aspect, image);
  const SignalDecoder light(std::move(signal), choice);
  light.describe(static_cast<int>(picture.depth), image);
  const auto pixel = [&image](uint32_t x, uint32_t y) {
    return reinterpret_cast<float*>(image.pixels.data() + y * image.row_bytes()) + size_t{4} * x;
  };
  for (uint32_t y = 0; y < crop.height; ++y) {
    const auto* const whole_row =
        reinterpret_cast<const uint16_t*>(rgb.pixels + size_t{crop.y + y} * rgb.rowBytes);
    const uint16_t* const row = whole_row + size_t{4} * crop.x;
    if (!upright.is_needed()) {
      light.decode({row, size_t{4} * crop.width}, pixel(0, y));
      continue;
    }
    for (uint32_t x = 0; x < crop.width; ++x) {
      const auto [to_x, to_y] = upright.place(x, y);
      light.decode({row + size_t{4} * x, 4}, pixel(to_x, to_y));
    }
  }
  return image;
}

}  // namespace candela
