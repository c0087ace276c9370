// A finished picture and its encoders. The client uses them too.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"

namespace candela {

// The transfer function that the picture's values are encoded with: of an SDR picture with the primaries of
// Rec.709, or, kPq and kHlg, of an HDR one.
enum class EncodedTransfer { kSrgb, kGamma22, kLinear, kPq, kHlg, kUnknown };

// What a file says of an HDR picture and of the display that it is made for.
struct HdrDisplay {
  bool p3 = false;             // the primaries are those of P3-D65, else of Rec.2020
  double peak_nits = 1000;     // of the display
  double max_light_nits = 0;   // MaxCLL: the largest of R, G and B of all pixels
  double mean_light_nits = 0;  // MaxFALL: the mean of each pixel's largest of R, G and B
};

// Pixels of R, G, B and alpha in the machine's byte order; rows from top to bottom. Does not own the pixels.
struct PictureView {
  uint32_t width = 0;   // pixels
  uint32_t height = 0;  // pixels
  bool wide = false;    // 16 bits per component, else 8
  const std::byte* rows = nullptr;
  size_t row_stride_bytes = 0;
  // The width : height of one pixel.
  uint16_t aspect_width = 1;
  uint16_t aspect_height = 1;

  const std::byte* row(uint32_t y) const { return rows + y * row_stride_bytes; }
};

// Takes the file's next bytes. If it returns false, encoding stops.
using ByteSink = absl::FunctionRef<bool(const void* bytes, size_t count)>;

struct PngOptions {
  bool alpha = false;  // else the fourth component is dropped
  EncodedTransfer transfer = EncodedTransfer::kSrgb;
  HdrDisplay hdr{};       // with the transfers kPq and kHlg
  std::string profile{};  // an ICC profile in place of chunks for the primaries of Rec.709 and the transfer
  std::vector<std::pair<std::string, std::string>> text{};  // keyword and text, Latin-1
  // That encode stripes of the picture at the same time. 0: one for each CPU of this process that no other
  // picture is being encoded on, and one at least.
  uint32_t threads = 0;
};

// Writes colour and alpha as they are. The same picture and options give the same bytes on any number of
// threads, and on any x86-64 processor with SSE4.2 (without, isa-l looks for runs in another way). INTERNAL
// with the reason, or if the sink returned false. The sink is called from any of the threads, but never from
// two at the same time.
absl::Status encode_png(const PictureView& picture, const PngOptions& options, ByteSink sink);

struct GainMapCodes;

struct JpegOptions {
  int quality = 92;  // 1 .. 100
  // The file carries an ICC profile of it and Rec.709, or none if it is unknown.
  EncodedTransfer transfer = EncodedTransfer::kSrgb;
  std::string profile{};  // in place of that one
  // Makes a gain-map JPEG, whose base is the file without one. The picture's fourth component is not used.
  const GainMapCodes* gain_map = nullptr;
};

// Keeps colour at full resolution (4:4:4), because lamps on a dark background smear otherwise. `picture` must
// not be wide. INTERNAL with libjpeg's reason, or if the sink returned false.
absl::Status encode_jpeg(const PictureView& picture, const JpegOptions& options, ByteSink sink);

// For a JPEG or a TIFF, which has no word for its primaries and transfer.
// A profile (ICC.1:2010) of Rec.709 primaries, D65 and this transfer. "" if the transfer is unknown or memory
// runs out. The same transfer gives the same bytes. Any thread; the profile is made once.
const std::string& icc_profile(EncodedTransfer transfer);
// The same of other primaries: CIE 1931 xy of red, green, blue and white. `name` is that of its description,
// ASCII.
std::string icc_profile(EncodedTransfer transfer, const std::array<float, 8>& xy, const std::string& name);

}  // namespace candela
