// A finished picture as its encoders see it. Also the client's.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"

namespace candela {

// The transfer that a picture's values were encoded with.
enum class EncodedTransfer { kSrgb, kGamma22, kLinear, kUnknown };

// Four components a pixel, R, G, B and alpha, in the machine's byte order; rows from top to bottom. Not
// owned.
struct PictureView {
  uint32_t width = 0;   // pixels
  uint32_t height = 0;  // pixels
  bool wide = false;    // 16 bits a component, else 8
  const std::byte* rows = nullptr;
  size_t row_stride_bytes = 0;
  // A pixel's width : height.
  uint16_t aspect_width = 1;
  uint16_t aspect_height = 1;

  const std::byte* row(uint32_t y) const { return rows + y * row_stride_bytes; }
};

// Takes the file's next bytes; false: it cannot, and no more come.
using ByteSink = absl::FunctionRef<bool(const void* bytes, size_t count)>;

struct PngOptions {
  bool alpha = false;  // else the fourth component is left out
  EncodedTransfer transfer = EncodedTransfer::kSrgb;
  std::vector<std::pair<std::string, std::string>> text{};  // keyword and text, Latin-1
};

// Colour as it is, not divided by alpha. INTERNAL with libpng's reason, or where the sink refused.
absl::Status encode_png(const PictureView& picture, const PngOptions& options, ByteSink sink);

// With colour at full resolution (4:4:4): lamps on a dark ground smear otherwise. `picture` is not wide;
// `quality` is 1 .. 100. INTERNAL with libjpeg's reason, or where the sink refused.
absl::Status encode_jpeg(const PictureView& picture, int quality, ByteSink sink);

}  // namespace candela
