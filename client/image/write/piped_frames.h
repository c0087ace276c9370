// Frames of a film as bytes for a pipe: y4m (YUV4MPEG2) and PAM.
//
// y4m holds limited range and the matrix of BT.709, or of fewer than 720 lines that of BT.601, which its
// readers assume (Y = .299 R + .587 G + .114 B, 1.772 and 1.402): with R, G, B in 0 .. 1 and n bits, s =
// 2^(n-8), luma Y = .2126 R + .7152 G + .0722 B has the code s (16 + 219 Y), Cb = (B - Y) / 1.8556 and Cr =
// (R - Y) / 1.5748 have s (128 + 224 C), rounded to nearest. With the primaries of Rec.2020 it is the matrix
// of BT.2020 of non-constant luminance: Y = .2627 R + .6780 G + .0593 B, Cb = (B - Y) / 1.8814 and Cr = (R -
// Y) / 1.4746. They are computed in float32 from codes of 16 bits, so a code is within .52 of float64 on
// unrounded signals. With 4:2:0, chroma stands beside the even pixels of a row, midway between two rows: R,
// G, B are weighted 1 2 1 along the row and 1 1 down, and the picture's edge is repeated. The header says so
// at 8 bits (420mpeg2). At 10 bits y4m has no word for it, and readers assume the same place.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "client/image/color.h"
#include "client/image/image.h"
#include "client/image/write/encodings.h"

namespace candela {

enum class PipeKind { kY4m420, kY4m444, kPam };

struct PipeFormat {
  PipeKind kind = PipeKind::kY4m420;
  int bits = 8;  // of y4m 8 or 10; of PAM 8 or 16
  // Of a y4m. Absent: BT.601's below kHdLines, which its readers assume there, else BT.709's.
  std::optional<LumaMatrix> matrix{};
};

// The format of pictures with this transfer; `hdr` is that of PQ and HLG. `bits` is 0 for the usual depth.
PipeFormat pipe_format(PipeKind kind, int bits, EncodedTransfer transfer, const HdrDisplay& hdr);

// What the frames have in common with files. A y4m has no alpha, and is made from codes of 16 bits.
const OutputEncoding& piped_encoding(PipeKind kind);

// The matrix of a y4m whose frames have so many lines.
LumaMatrix matrix_of(const PipeFormat& format, uint32_t height);

// The line before the first frame; "" for PAM.
std::string film_header(const PipeFormat& format, uint32_t width, uint32_t height, double pixel_aspect,
                        FrameRate rate);

// A frame with its own header. `picture` is kRgba16, or for PAM of 8 bits kRgba8. PAM has its alpha if it has
// one, which is straight.
void make_piped_frame(const PipeFormat& format, const Image& picture, std::vector<std::byte>& bytes);

}  // namespace candela
