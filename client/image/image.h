// An image in memory, and image files in and out: OpenEXR, Radiance .hdr, PFM, PNG, AVIF, JPEG and TIFF are
// read; client/image/write/encodings.h lists what is written.
//
// It needs no network and no device. Any thread may call these functions, also at once on different images.
// OpenEXR decodes with the number of threads set by Imf::setGlobalThreadCount, which the caller chooses; the
// default is none.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/base/pixel_memory.h"
#include "server/encode/picture.h"

namespace candela {

// How many frames of a sequence are shown in how many seconds: an exact fraction, because film rates such as
// 24000/1001 are no decimal numbers.
struct FrameRate {
  uint64_t frames = 24;  // at least 1
  uint64_t seconds = 1;  // at least 1

  bool operator==(const FrameRate& other) const = default;
};

// The film rate that a decimal number stands for: N * 1000/1001 for N of 24, 30, 48, 60 and 120, of which it
// is one rounded to two decimals or more. 23.976 and 23.98 are 24000/1001. Nothing for all others.
std::optional<FrameRate> film_rate(double frames_a_second);

// The bytes of an image.
//
// Move-only; not thread-safe. A buffer that could not be allocated has size() 0.
class PixelBuffer {
 public:
  PixelBuffer() = default;
  // Zeros, and what is never written takes no memory. So a reader needs to fill only what the file holds.
  explicit PixelBuffer(size_t bytes) : PixelBuffer(new_pixels(bytes), bytes) {}
  PixelBuffer(PixelMemory memory, size_t bytes) : bytes_(std::move(memory)), size_(bytes_ ? bytes : 0) {}
  PixelBuffer(PixelBuffer&& other) noexcept
      : bytes_(std::move(other.bytes_)), size_(std::exchange(other.size_, 0)) {}
  PixelBuffer& operator=(PixelBuffer&& other) noexcept {
    bytes_ = std::move(other.bytes_);
    size_ = std::exchange(other.size_, 0);
    return *this;
  }

  std::byte* data() { return bytes_.get(); }
  const std::byte* data() const { return bytes_.get(); }
  size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  std::span<const std::byte> span() const { return {data(), size_}; }
  std::span<std::byte> span() { return {data(), size_}; }

 private:
  PixelMemory bytes_;
  size_t size_ = 0;
};

class KeptAttributes;
struct OutputEncoding;

// Four interleaved components, red first, little endian; rows from the top without padding. Servers render to
// the integer formats; files are never read to them.
enum class ImageFormat { kRgba16f, kRgba32f, kRgba8, kRgba16 };

constexpr uint32_t bytes_per_pixel(ImageFormat format) {
  return format == ImageFormat::kRgba8 ? 4 : format == ImageFormat::kRgba32f ? 16 : 8;
}

const char* name(ImageFormat format);  // "rgba16f"

// What a picture's values are.
enum class PictureLight {
  kScene,  // light of a scene
  kSdr,    // light of a display, whose white is 1: a finished picture
  kHdr     // the same of a PQ or HLG signal or a gain map: 1 is reference white, and some may be brighter
};

struct Image {
  uint32_t width = 0;
  uint32_t height = 0;
  ImageFormat format = ImageFormat::kRgba16f;
  PixelBuffer pixels;                   // bytes() bytes
  bool has_alpha = false;               // false: every alpha is 1
  bool is_cube_map = false;             // the file says that it is the six faces of a cube map
  double pixel_aspect = 1.0;            // width / height of one pixel
  std::optional<FrameRate> frame_rate;  // of the sequence that the image belongs to
  // CIE 1931 xy of red, green, blue and white: rx ry gx gy bx by wx wy. Without them: Rec.709 and D65.
  std::optional<std::array<float, 8>> chromaticities;
  PictureLight light = PictureLight::kScene;
  double peak = 1;               // of kHdr: the brightest light that the picture may hold
  std::string signal;            // of a PNG, AVIF, JPEG or TIFF file: "10 bits, PQ, from nclx"; "" of others
  bool has_gain_map = false;     // the file has one with the words that it needs, used or not
  bool names_primaries = false;  // the file says what its primaries are, which may be Rec.709
  uint64_t missing_pixels = 0;   // of an unfinished or damaged file: absent, which is 0 with alpha 0
  std::shared_ptr<const KeptAttributes> kept;  // what an OpenEXR output keeps of an OpenEXR input; or null
  std::vector<std::string> notes;              // messages for the user, such as "EXPOSURE 0.5 divided out"

  uint64_t row_bytes() const { return uint64_t{width} * bytes_per_pixel(format); }
  uint64_t bytes() const { return row_bytes() * height; }
};

// An image of zeros. RESOURCE_EXHAUSTED if there is not enough memory.
absl::StatusOr<Image> make_image(uint32_t width, uint32_t height, ImageFormat format);

// The same with any pixels. The caller writes every one before any is read.
absl::StatusOr<Image> image_to_overwrite(uint32_t width, uint32_t height, ImageFormat format);

// The image with its halves as floats. RESOURCE_EXHAUSTED if there is not enough memory.
absl::StatusOr<Image> to_floats(Image image);

// The largest image that a reader accepts. It checks the file's header before it allocates memory for pixels.
// The limit on the dimension also applies to an OpenEXR file's data window, the part of the picture that it
// stores.
struct ImageLimits {
  uint32_t max_dimension = 16384;  // width or height, in pixels
  uint64_t max_bytes = 1u << 29;   // bytes of pixels in the format that the file is read to
  uint64_t max_pixels = 0;         // 0: no limit of their own
  // OpenEXR decodes whole chunks, which are some rows or a tile of all channels, and several of them at once.
  // A header may ask for chunks of any size.
  uint64_t max_chunk_bytes = 256u << 20;
};

// Which row of a PFM or PHM file comes first. By kind: the lowest of a PFM file, as that format says, and the
// top one of a PHM file, as ffmpeg writes it. ffmpeg writes PFM files from the top, too.
enum class RowOrder { kByKind, kTop, kBottom };

// The function from a file's codes to light.
enum class SignalTransfer {
  kLinear,
  kSrgb,
  kGamma,  // a power
  kPq,
  kHlg,
  kSmpte240,  // the camera of SMPTE ST 240
  kLog100,    // H.273's logarithms, of two and of two and a half decades
  kLog316,
  kCinema,  // SMPTE ST 428-1
  kProfile  // an ICC profile's own; no choice
};

// Which of an OpenEXR file's pictures to read. The reader chooses where a member is empty: it takes the
// picture whose name says best that it is the one to show.
struct PictureChoice {
  std::string part{};  // its name, or its number, counted from 1
  // NAME of the channels NAME.R, NAME.G ...; or the full name of a channel, read as grey; or RGB, RGBA or
  // XYZ, for those without a layer.
  std::string layer{};
  std::string view{};  // of a stereo or multi-view file, such as "left"
  // Reads what there is of an unfinished or damaged file of any kind. Its other pixels are absent.
  bool fills_gaps = false;
  // The values as they stand in the file, of any kind: what it says about its colours is not used.
  bool own_values = false;
  bool as_floats = false;             // halves become floats
  RowOrder rows = RowOrder::kByKind;  // of a PFM or PHM file
  // In place of the one that the file names. Absent: the one that it names, else sRGB of a PNG, AVIF or JPEG
  // file or a TIFF of integers, and of others none: their values are light.
  std::optional<SignalTransfer> transfer{};
  double gamma = 2.2;  // of the transfer kGamma
  // In place of what an AVIF or a y4m says of its luma, and of its range, which a PNG may say, too. The
  // matrix is H.273's number.
  std::optional<int> matrix{};
  std::optional<bool> full_range{};
  // The primaries that the user names, which give an HLG signal its luminance. Absent: the file's own.
  std::optional<std::array<float, 8>> primaries{};
  double hlg_peak = 1000.0;       // nit of the display that an HLG signal is meant for, 400 .. 2000
  bool keeps_signal = false;      // a PNG's, AVIF's, JPEG's or TIFF's codes as numbers of 0 .. 1
  bool base_of_gain_map = false;  // of a file with a gain map the picture without it

  // Whether it names no picture.
  bool empty() const { return part.empty() && layer.empty() && view.empty(); }
};

// Reads an OpenEXR, Radiance, PFM, PHM, PNG, AVIF, JPEG or TIFF file; its first bytes tell the kind, not its
// name. OpenEXR and PHM files of halves become kRgba16f, all others kRgba32f. Values are the file's own.
// exr_reader.cc and radiance_reader.cc say what they do where the formats leave a choice. Errors name the
// file and the problem: NOT_FOUND (also for a part, layer or view, with a list of those that exist),
// PERMISSION_DENIED, INVALID_ARGUMENT (not an image, damaged, unfinished, nothing to render, nothing to
// choose from), RESOURCE_EXHAUSTED (beyond the limits) or UNIMPLEMENTED (deep images, a compression, a
// version or a kind of samples that is not read). Their kind is kInput, or kOther if this machine lacks
// memory (client/base/failure.h).
absl::StatusOr<Image> read_image(const std::string& path, const ImageLimits& limits = {},
                                 const PictureChoice& choice = {});

// The same of a file that is in memory. `name` stands for its path.
absl::StatusOr<Image> read_image_bytes(const std::string& name, std::string bytes,
                                       const ImageLimits& limits = {}, const PictureChoice& choice = {});

// Like output_encoding() in client/image/write/encodings.h, but also fails, without writing, if the folder is
// missing or not writable or the path is a folder, a FIFO or a device. Call it before minutes of rendering.
absl::StatusOr<const OutputEncoding*> check_output_path(const std::string& path);

struct WriteOptions {
  // The transfer of the integer formats. A PNG gets an sRGB chunk, or gAMA and cHRM chunks, that say so, and
  // a JPEG or TIFF an ICC profile. None gets any if it is unknown.
  EncodedTransfer transfer = EncodedTransfer::kSrgb;
  HdrDisplay hdr{};  // with the transfers kPq and kHlg
  // Of the integer formats without PQ and HLG, in place of Rec.709: as Image::chromaticities.
  std::optional<std::array<float, 8>> primaries{};
  // Above 0: the fourth component of each pixel is not its alpha but its code in the JPEG's gain map; see
  // gain_map_in_alpha().
  double gain_map_max_log2 = 0;
  std::shared_ptr<const GainMapCodes> gain_map{};  // of a JPEG: another gain map, or null
  int jpeg_quality = 92;                           // 1..100, of a JPEG or AVIF
  bool associated_alpha = false;                   // a TIFF says whether its colour is multiplied by alpha
  // Keywords (1..79 characters) and texts for a PNG's tEXt chunks, in Latin-1. Other formats ignore them.
  std::vector<std::pair<std::string, std::string>> text = {};
};

// Writes the image in the encoding of the path's extension, which must take its format. Colour and alpha are
// stored as they are; formats without alpha drop it. The file appears complete or not at all; after a failure
// the old file is as it was. A new file has the permissions of the one that it replaces, and links to it stay
// valid. Returns messages for the user, such as "alpha dropped: .jpg has none". Errors are of the kind
// kOutput (client/base/failure.h).
absl::StatusOr<std::vector<std::string>> write_image(const std::string& path, const Image& image,
                                                     const WriteOptions& options = {});

// The same to standard output, where the image comes whole or not at all, and a reader that has gone is no
// error. `name` tells the encoding by its extension.
absl::StatusOr<std::vector<std::string>> write_image_to_stdout(const std::string& name, const Image& image,
                                                               const WriteOptions& options = {});

}  // namespace candela
