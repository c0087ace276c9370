// The frames of a y4m (YUV4MPEG2): planes of luma and two of chroma, of 8 or 10 bits.
//
// Luma Y = kr R + kg G + kb B, Cb = (B - Y) / (2 - 2 kb) and Cr = (R - Y) / (2 - 2 kr), of limited or full
// range, with the weights of BT.601, BT.709 or BT.2020, or those that the user names. Chroma between its
// samples is linear, and the edge's repeats.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/image/color.h"
#include "client/image/image.h"
#include "client/image/read/signal.h"

namespace candela {

inline constexpr absl::string_view kY4mMagic = "YUV4MPEG2", kY4mFrame = "FRAME";

class Y4mFrames {
 public:
  // By the header's line, without its end. INVALID_ARGUMENT, with `name`, if it is none; UNIMPLEMENTED for
  // planes that are not read; RESOURCE_EXHAUSTED beyond the limits.
  static absl::StatusOr<Y4mFrames> of(const std::string& name, absl::string_view header,
                                      const ImageLimits& limits, const PictureChoice& choice);

  // The size of a frame's planes.
  uint64_t frame_bytes() const;

  // The picture of such bytes. RESOURCE_EXHAUSTED if there is not enough memory.
  absl::StatusOr<Image> image(std::span<const std::byte> planes) const;

 private:
  // The size and place of chroma samples relative to luma.
  struct Chroma {
    const char* word;  // "420mpeg2"
    int bits;
    bool none, halved_across, halved_down;
    bool centred;  // midway between two columns, else beside the even ones
  };
  static const Chroma kChromas[];

  Y4mFrames(const Chroma& chroma, const LumaMatrix& matrix, SignalDecoder decoder)
      : chroma_(chroma), matrix_(matrix), decoder_(std::move(decoder)) {}

  uint32_t chroma_width() const { return chroma_.halved_across ? (width_ + 1) / 2 : width_; }
  uint32_t chroma_height() const { return chroma_.halved_down ? (height_ + 1) / 2 : height_; }

  // A row of Cb or Cr, -0.5 .. 0.5, as wide as luma. `plane` begins the plane.
  void chroma_row(std::span<const std::byte> plane, uint32_t y, std::span<float> row) const;

  Chroma chroma_;
  LumaMatrix matrix_;
  SignalDecoder decoder_;
  uint32_t width_ = 0, height_ = 0;
  bool full_ = false;
  double pixel_aspect_ = 1;
  std::optional<FrameRate> rate_;
  std::vector<std::string> notes_;
};

}  // namespace candela
