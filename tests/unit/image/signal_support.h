// Helpers for the tests of files that hold a signal.
#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>

#include "client/image/image.h"
#include "client/image/read/signal.h"
#include "tests/support/status.h"

namespace candela {

inline uint16_t code_of(double signal) { return static_cast<uint16_t>(std::lround(signal * 65535)); }

// The light of a signal, in nit of reference white 203, for R, G, B.
inline std::array<double, 3> nits(const Signal& signal, std::array<double, 3> v,
                                  const PictureChoice& choice = {}) {
  const std::array<uint16_t, 4> codes = {code_of(v[0]), code_of(v[1]), code_of(v[2]), 65535};
  float light[4];
  SignalDecoder(signal, choice).decode(codes, light);
  return {light[0] * 203.0, light[1] * 203.0, light[2] * 203.0};
}

inline Signal of_code_points(int primaries, int transfer) {
  Signal signal;
  EXPECT_OK(set_code_points("file", primaries, transfer, signal));
  return signal;
}

inline absl::StatusOr<Image> read_signal(const std::string& bytes, const PictureChoice& choice = {}) {
  return read_image_bytes("file", bytes, {}, choice);
}

inline float light_at(const Image& image, uint32_t x, size_t component) {
  float v;
  std::memcpy(&v, image.pixels.data() + x * 16 + component * 4, sizeof v);
  return v;
}

}  // namespace candela
