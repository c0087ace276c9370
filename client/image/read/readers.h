// The readers of the file kinds, for read_image(). Internal to client/image. Each keeps read_image()'s
// promises.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/image/describe.h"
#include "client/image/image.h"
#include "client/image/read/file_reader.h"

namespace candela {

enum class FileKind { kExr, kRadiance, kPfm, kPng, kAvif, kJpeg, kTiff };

// The kind by the file's first bytes. INVALID_ARGUMENT, with the file's name, for all others.
absl::StatusOr<FileKind> file_kind(FileReader& file);

absl::StatusOr<Image> read_exr(FileReader& file, const ImageLimits& limits, const PictureChoice& choice);
absl::StatusOr<FileFacts> describe_exr(FileReader& file, const ImageLimits& limits);
// Of a file that ends too early or is damaged, `fills_gaps` reads what comes before. PFM is PHM, too.
absl::StatusOr<Image> read_radiance(FileReader& file, const ImageLimits& limits, bool fills_gaps = false);
// These say what they make of the files' signals: signal.h.
absl::StatusOr<Image> read_png(FileReader& file, const ImageLimits& limits, const PictureChoice& choice);
absl::StatusOr<Image> read_avif(FileReader& file, const ImageLimits& limits, const PictureChoice& choice);
absl::StatusOr<Image> read_jpeg(FileReader& file, const ImageLimits& limits, const PictureChoice& choice);
absl::StatusOr<Image> read_tiff(FileReader& file, const ImageLimits& limits, const PictureChoice& choice);
absl::StatusOr<Image> read_pfm(FileReader& file, const ImageLimits& limits, const PictureChoice& choice);

// Checks a size against the limits. `what` names the thing in the user's words, such as "image" or "data
// window"; `format` is the format that its pixels will be read to. Accepts any numbers that a header may
// hold.
absl::Status check_image_size(const std::string& path, const char* what, int64_t width, int64_t height,
                              ImageFormat format, const ImageLimits& limits);

// The error about a file that is not whole, with the option that renders the rest.
absl::Status or_fill(const absl::Status& status);

// Makes `missing` pixels of the image count as absent, with a note. `why` is the error without the option.
void note_missing(const std::string& path, const absl::Status& why, uint64_t missing, Image& image);

// Text from a file, safe to print: its first `most` bytes, with everything but printable UTF-8 as \xNN.
// Otherwise a file could put line ends or terminal commands into a message. A character is never cut.
std::string printable(absl::string_view text, size_t most = 40);

// The number that `size` bytes, at most 4, at this place make, the highest first. 0 if they are not all
// there.
uint32_t big_endian_at(absl::string_view bytes, uint64_t at, size_t size = 4);

// Sets the image's primaries and white, and that the file names them. Leaves them out if they are Rec.709 and
// D65 within 1e-4. Ignores them with a note if they give no matrix: not finite, a white without luminance, or
// primaries on a line.
void set_chromaticities(const std::array<float, 8>& xy, Image& image);

// Sets a pixel's width over its height. Ignores it with a note if it is not finite or outside 0.01 .. 100.
void set_pixel_aspect(double aspect, Image& image);

}  // namespace candela
