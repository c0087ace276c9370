// What files say of a picture's colours, in their own numbers.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "server/encode/picture.h"

namespace candela {

constexpr bool is_hdr(EncodedTransfer transfer) {
  return transfer == EncodedTransfer::kPq || transfer == EncodedTransfer::kHlg;
}

// Code points of ITU-T H.273. The matrix is that of Y, Cb and Cr.
struct CodePoints {
  uint8_t primaries, transfer, matrix;
};
constexpr CodePoints code_points(EncodedTransfer transfer, const HdrDisplay& hdr) {
  constexpr uint8_t kBt709 = 1, kUnspecified = 2, kBt2020 = 9, kSmpteP3 = 12;
  switch (transfer) {
    case EncodedTransfer::kSrgb:
      return {kBt709, 13, kBt709};
    case EncodedTransfer::kGamma22:
      return {kBt709, 4, kBt709};
    case EncodedTransfer::kLinear:
      return {kBt709, 8, kBt709};
    case EncodedTransfer::kPq:
    case EncodedTransfer::kHlg: {
      const uint8_t code = transfer == EncodedTransfer::kPq ? 16 : 18;
      return hdr.p3 ? CodePoints{kSmpteP3, code, kBt709} : CodePoints{kBt2020, code, kBt2020};
    }
    case EncodedTransfer::kUnknown:
      break;
  }
  return {kUnspecified, kUnspecified, kBt709};
}

// CIE 1931 x and y of a display's primaries and white, D65, in units of .00002 (SMPTE ST 2086).
using DisplayPoint = std::array<uint16_t, 2>;
struct DisplayPoints {
  DisplayPoint red, green, blue, white;
};
constexpr DisplayPoints display_points(const HdrDisplay& hdr) {
  constexpr DisplayPoint kD65{15635, 16450};
  return hdr.p3 ? DisplayPoints{{34000, 16000}, {13250, 34500}, {7500, 3000}, kD65}
                : DisplayPoints{{35400, 14600}, {8500, 39850}, {6550, 2300}, kD65};
}

// A luminance of 0 .. 10000 nit in units of .0001 nit.
inline uint32_t luminance_units(double nits) {
  return static_cast<uint32_t>(std::lround(std::min(10000.0, std::max(0.0, nits)) * 10000));
}

}  // namespace candela
