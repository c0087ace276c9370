#include "client/image/write/piped_frames.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "client/base/failure.h"
#include "tests/support/status.h"

namespace candela {
namespace {

// A picture, and the signals in 0 .. 1 that its codes of 16 bits were rounded from.
struct Signals {
  Image picture;
  std::vector<double> rgb;
};

// Random colours, with the corners of the cube and greys among them.
Signals random_signals(uint32_t width, uint32_t height) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> any(0, 1);
  Signals made;
  made.picture = *make_image(width, height, ImageFormat::kRgba16);
  for (uint32_t i = 0; i < width * height; ++i) {
    const double grey = any(random);
    uint16_t codes[4] = {0, 0, 0, 65535};
    for (int c = 0; c < 3; ++c) {
      const double value = i % 7 == 0 ? (i >> c & 1) : i % 7 == 1 ? grey : any(random);
      made.rgb.push_back(value);
      codes[c] = static_cast<uint16_t>(std::lround(value * 65535));
    }
    std::memcpy(made.picture.pixels.data() + 8 * size_t{i}, codes, sizeof codes);
  }
  return made;
}

// The planes of BT.709 or BT.2020 in float64, from the unrounded signals: luma, Cb, Cr.
std::vector<double> twin(const Signals& from, const PipeFormat& format) {
  const int width = static_cast<int>(from.picture.width), height = static_cast<int>(from.picture.height);
  const double scale = std::exp2(format.bits - 8);
  const double kr = format.rec2020 ? .2627 : .2126, kb = format.rec2020 ? .0593 : .0722;
  const auto signal = [&](int x, int y, int c) {
    const int i = std::min(y, height - 1) * width + std::clamp(x, 0, width - 1);
    return from.rgb[static_cast<size_t>(3 * i + c)];
  };
  const auto luma = [&](const double* rgb) { return kr * rgb[0] + (1 - kr - kb) * rgb[1] + kb * rgb[2]; };
  std::vector<double> planes;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double rgb[3] = {signal(x, y, 0), signal(x, y, 1), signal(x, y, 2)};
      planes.push_back(scale * (16 + 219 * luma(rgb)));
    }
  }
  const bool halved = format.kind == PipeKind::kY4m420;
  const int step = halved ? 2 : 1;
  for (const int component : {2, 0}) {
    const double range = component == 2 ? 2 * (1 - kb) : 2 * (1 - kr);
    for (int y = 0; y < height; y += step) {
      for (int x = 0; x < width; x += step) {
        double rgb[3];
        for (int c = 0; c < 3; ++c) {
          rgb[c] = signal(x, y, c);
          if (!halved) continue;
          rgb[c] = 0;
          for (int down = 0; down < 2; ++down) {
            for (int along = -1; along < 2; ++along) {
              rgb[c] += (along == 0 ? .25 : .125) * signal(x + along, y + down, c);
            }
          }
        }
        planes.push_back(scale * (128 + 224 * (rgb[component] - luma(rgb)) / range));
      }
    }
  }
  return planes;
}

std::string text_of(const std::vector<std::byte>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// The codes after the frame's word.
std::vector<int> codes_of(const std::vector<std::byte>& frame, int bits) {
  std::vector<int> codes;
  for (size_t i = 6; i<frame.size(); i += bits> 8 ? 2 : 1) {
    codes.push_back(std::to_integer<int>(frame[i]) |
                    (bits > 8 ? std::to_integer<int>(frame[i + 1]) << 8 : 0));
  }
  return codes;
}

TEST(PipedFrames, AVideoIsWithinHalfACodeOfFloat64) {
  for (const PipeKind kind : {PipeKind::kY4m420, PipeKind::kY4m444}) {
    for (const auto& [bits, rec2020] : {std::pair(8, false), {10, false}, {10, true}}) {
      double most = 0;
      for (const auto& [width, height] : {std::pair(257, 129), {1, 1}, {1, 2}, {2, 1}, {3, 3}, {64, 2}}) {
        const Signals signals = random_signals(static_cast<uint32_t>(width), static_cast<uint32_t>(height));
        std::vector<std::byte> frame;
        make_piped_frame({kind, bits, rec2020}, signals.picture, frame);
        ASSERT_EQ(text_of(frame).substr(0, 6), "FRAME\n");
        const std::vector<int> codes = codes_of(frame, bits);
        const std::vector<double> exact = twin(signals, {kind, bits, rec2020});
        ASSERT_EQ(codes.size(), exact.size()) << width << "x" << height;
        for (size_t i = 0; i < codes.size(); ++i) most = std::max(most, std::fabs(codes[i] - exact[i]));
      }
      // Half a code is the rounding; the codes of 16 bits are the rest.
      EXPECT_LE(most, bits == 8 ? 0.503 : 0.508) << bits;
      RecordProperty((kind == PipeKind::kY4m420 ? "most_420_" : "most_444_") + std::to_string(bits) +
                         (rec2020 ? "_rec2020" : ""),
                     std::to_string(most));
      printf("%s, %d bits%s: at most %.4f codes\n", kind == PipeKind::kY4m420 ? "4:2:0" : "4:4:4", bits,
             rec2020 ? ", BT.2020" : "", most);
    }
  }
}

TEST(PipedFrames, TheHeaderSaysWhatTheFramesAre) {
  const FrameRate ntsc{24000, 1001};
  EXPECT_EQ(film_header({PipeKind::kY4m420, 8}, 1920, 1080, 1, ntsc),
            "YUV4MPEG2 W1920 H1080 F24000:1001 Ip A1:1 C420mpeg2 XYSCSS=420MPEG2 XCOLORRANGE=LIMITED\n");
  EXPECT_EQ(film_header({PipeKind::kY4m420, 10}, 31, 17, 1.5, {25, 1}),
            "YUV4MPEG2 W31 H17 F25:1 Ip A3:2 C420p10 XYSCSS=420P10 XCOLORRANGE=LIMITED\n");
  EXPECT_EQ(film_header({PipeKind::kY4m444, 8}, 2, 1, 1, {24, 1}),
            "YUV4MPEG2 W2 H1 F24:1 Ip A1:1 C444 XYSCSS=444 XCOLORRANGE=LIMITED\n");
  EXPECT_EQ(film_header({PipeKind::kY4m444, 10}, 2, 1, 1, {24, 1}),
            "YUV4MPEG2 W2 H1 F24:1 Ip A1:1 C444p10 XYSCSS=444P10 XCOLORRANGE=LIMITED\n");
  EXPECT_EQ(film_header({PipeKind::kPam, 8}, 2, 1, 1, {24, 1}), "");
}

TEST(PipedFrames, BlackAndWhiteAndTheirChromaAreTheStandards) {
  for (const int bits : {8, 10}) {
    const int scale = bits == 8 ? 1 : 4;
    for (const uint16_t code : {uint16_t{0}, uint16_t{65535}}) {
      Image picture = *make_image(4, 4, ImageFormat::kRgba16);
      for (size_t i = 0; i < 64; ++i) std::memcpy(picture.pixels.data() + 2 * i, &code, 2);
      std::vector<std::byte> frame;
      make_piped_frame({PipeKind::kY4m420, bits}, picture, frame);
      const std::vector<int> codes = codes_of(frame, bits);
      ASSERT_EQ(codes.size(), 24u);
      for (size_t i = 0; i < 24; ++i) EXPECT_EQ(codes[i], scale * (i >= 16 ? 128 : code == 0 ? 16 : 235));
    }
  }
}

// 10-bit codes of BT.2020's primary colours, by hand: 64 + 876 K, and 512 + 896 (1 - K) / (2 (1 - K)) = 960
// of the colour's own difference.
TEST(PipedFrames, TheCodesOfRec2020AreTheStandards) {
  const struct {
    uint16_t rgb[3];
    int codes[3];  // luma, Cb, Cr
  } colours[] = {{{65535, 0, 0}, {294, 387, 960}},
                 {{0, 65535, 0}, {658, 189, 100}},
                 {{0, 0, 65535}, {116, 960, 476}},
                 {{65535, 65535, 65535}, {940, 512, 512}}};
  for (const auto& [rgb, codes] : colours) {
    Image picture = *make_image(1, 1, ImageFormat::kRgba16);
    std::memcpy(picture.pixels.data(), rgb, sizeof rgb);
    std::vector<std::byte> frame;
    make_piped_frame({PipeKind::kY4m444, 10, true}, picture, frame);
    EXPECT_EQ(codes_of(frame, 10), std::vector<int>(std::begin(codes), std::end(codes)));
  }
}

TEST(PipedFrames, PqAndHlgHaveTenBitsAndTheMatrixOfTheirPrimaries) {
  for (const auto transfer : {EncodedTransfer::kPq, EncodedTransfer::kHlg}) {
    for (const int bits : {0, 10}) {
      const PipeFormat wide = pipe_format(PipeKind::kY4m420, bits, transfer, {});
      EXPECT_EQ(wide.bits, 10);
      EXPECT_TRUE(wide.rec2020);
      const PipeFormat p3 = pipe_format(PipeKind::kY4m444, bits, transfer, {.p3 = true});
      EXPECT_EQ(p3.bits, 10);
      EXPECT_FALSE(p3.rec2020);
    }
  }
  const PipeFormat sdr = pipe_format(PipeKind::kY4m420, 0, EncodedTransfer::kSrgb, {});
  EXPECT_EQ(sdr.bits, 8);
  EXPECT_FALSE(sdr.rec2020);
  EXPECT_EQ(pipe_format(PipeKind::kY4m420, 10, EncodedTransfer::kSrgb, {}).bits, 10);
}

TEST(PipedFrames, APamHoldsTheCodesAndTheAlpha) {
  Image picture = *make_image(2, 1, ImageFormat::kRgba16);
  const uint16_t codes[] = {0x0102, 0x0304, 0x0506, 0x0708, 9, 10, 11, 12};
  std::memcpy(picture.pixels.data(), codes, sizeof codes);
  std::vector<std::byte> frame;
  make_piped_frame({PipeKind::kPam, 16}, picture, frame);
  EXPECT_EQ(text_of(frame),
            std::string("P7\nWIDTH 2\nHEIGHT 1\nDEPTH 3\nMAXVAL 65535\nTUPLTYPE RGB\nENDHDR\n") +
                std::string("\1\2\3\4\5\6\0\x9\0\xa\0\xb", 12));
  Image small = *make_image(1, 1, ImageFormat::kRgba8);
  std::memcpy(small.pixels.data(), "abcd", 4);
  small.has_alpha = true;
  make_piped_frame({PipeKind::kPam, 8}, small, frame);
  EXPECT_EQ(text_of(frame), "P7\nWIDTH 1\nHEIGHT 1\nDEPTH 4\nMAXVAL 255\nTUPLTYPE RGB_ALPHA\nENDHDR\nabcd");
}

}  // namespace
}  // namespace candela
