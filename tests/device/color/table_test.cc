// The curves that use a table: aces-1 against OpenColorIO and published renders, and a client's table against
// its float64 look-up.
#include <gtest/gtest.h>
#include <half.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "client/image/image.h"
#include "proto/candela/v1/settings.h"
#include "server/render/color/aces.h"
#include "server/render/color/primaries.h"
#include "shaders/reference.h"
#include "tests/support/device_fixture.h"
#include "tests/support/files.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"
#include "tests/unit/image/png.h"

namespace candela::testing {
namespace {

namespace fs = std::filesystem;

class Table : public DeviceTest {
 protected:
  static Verification difference(const WireFrame& frame, const v1::Settings& settings,
                                 const std::string& what) {
    const auto rendered = render(frame, settings, {}, Verify::kYes);
    EXPECT_OK(rendered) << what;
    if (!rendered.ok()) return {};
    const Verification& d = rendered->report.verification->rounded;
    std::printf("%-44s %9.5f %9.5f %9.6f\n", what.c_str(), d.max_codes, d.p999_codes, d.mean_codes);
    return d;
  }

  static void print_header(const char* what) {
    std::printf("%-44s %9s %9s %9s\n", what, "max", "p99.9", "mean");
  }

  static v1::Settings with(v1::ToneCurve curve) {
    v1::Settings settings;
    settings.set_curve(curve);
    return settings;
  }

  static v1::Settings with_table(uint32_t size) {
    v1::Settings settings = with(v1::TONE_CURVE_TABLE);
    *settings.mutable_table() = to_message(**aces_1_table(size));
    return settings;
  }
};

TEST_F(Table, Aces1IsWithinItsPublishedBoundOfOpenColorIO) {
  print_header("aces-1, codes against OpenColorIO");
  for (const Size& size : {Size{1, 1}, Size{3, 5}, Size{67, 67}, Size{333, 517}, Size{641, 359}}) {
    const std::string what = std::to_string(size.width) + "x" + std::to_string(size.height);
    const Verification d = difference(natural(size.width, size.height), with(v1::TONE_CURVE_ACES_1), what);
    EXPECT_LE(d.max_codes, 1.4) << what;
    EXPECT_LE(d.p999_codes, 0.7) << what;
    EXPECT_LE(d.mean_codes, 0.08) << what;
  }
  for (const HardCase& hard : hard_cases(130, 67)) {
    const Verification d = difference(make_frame(130, 67, v1::PIXEL_FORMAT_RGBA16F, hard.texel),
                                      with(v1::TONE_CURVE_ACES_1), hard.name);
    EXPECT_LE(d.max_codes, 1.4) << hard.name;
  }
}

TEST_F(Table, OfAClientIsItsFloat64LookUp) {
  print_header("table, codes against float64");
  for (uint32_t size : {2u, 3u, 17u, 33u, 65u}) {
    for (const Size& frame : {Size{1, 1}, Size{3, 5}, Size{333, 129}}) {
      const std::string what =
          std::to_string(size) + "^3, " + std::to_string(frame.width) + "x" + std::to_string(frame.height);
      EXPECT_LE(difference(natural(frame.width, frame.height), with_table(size), what).max_codes, 0.01)
          << what;
    }
    for (const HardCase& hard : hard_cases(130, 67)) {
      const std::string what = std::to_string(size) + "^3, " + hard.name;
      EXPECT_LE(difference(make_frame(130, 67, v1::PIXEL_FORMAT_RGBA32F, hard.texel), with_table(size), what)
                    .max_codes,
                0.01)
          << what;
    }
  }
}

TEST_F(Table, WithNoiseInEveryPointIsItsFloat64LookUp) {
  print_header("noise in every point");
  for (uint32_t axes : {shader::AXES_ACES, shader::AXES_REC709, shader::AXES_AP1}) {
    auto table = std::make_shared<ColorTable>(ColorTable{9, axes, 8.0f, {}});
    for (uint32_t i = 0; i < 9 * 9 * 9 * 3; ++i)
      table->values.push_back(static_cast<uint16_t>(65535.0f * noise(i, 0, 0)));
    v1::Settings settings = with(v1::TONE_CURVE_TABLE);
    *settings.mutable_table() = to_message(*table);
    EXPECT_LE(difference(natural(333, 129), settings, "9^3, axes " + std::to_string(axes)).max_codes, 0.1);
  }
}

TEST_F(Table, TransferAndFormatApplyToAces1ButNotToATable) {
  const WireFrame frame = natural(67, 33);
  for (v1::Transfer transfer : {v1::TRANSFER_SRGB, v1::TRANSFER_GAMMA22, v1::TRANSFER_LINEAR}) {
    for (v1::OutputFormat format : {v1::OUTPUT_FORMAT_RGBA16, v1::OUTPUT_FORMAT_RGBA16F}) {
      v1::Settings settings = with(v1::TONE_CURVE_ACES_1);
      settings.set_transfer(transfer);
      settings.set_output_format(format);
      const std::string what = v1::word_of(transfer) + " " + v1::word_of(format);
      EXPECT_LE(difference(frame, settings, what).max_codes, 2.0) << what;

      v1::Settings view = with_table(65);
      view.set_output_format(format);
      ASSERT_OK_AND_ASSIGN(auto plain, render(frame, view));
      view.set_transfer(transfer);
      ASSERT_OK_AND_ASSIGN(auto other, render(frame, view));
      EXPECT_EQ(image(plain.memory), image(other.memory)) << what;
    }
  }
}

TEST_F(Table, FramesAlternatingBetweenMoreTablesThanAreKeptStayThemselves) {
  const WireFrame frame = natural(67, 33);
  std::vector<std::vector<std::byte>> first;
  for (int round = 0; round < 3; ++round) {
    for (uint32_t i = 0; i < 7; ++i) {
      ASSERT_OK_AND_ASSIGN(auto rendered, render(frame, with_table(5 + i)));
      if (round == 0) first.push_back(image(rendered.memory));
      EXPECT_EQ(image(rendered.memory), first[i]) << round << " " << i;
    }
  }
}

TEST_F(Table, IsTheSameThroughStagingCopies) {
  DeviceOptions options;
  options.staging = true;
  ASSERT_OK_AND_ASSIGN(auto staged_device, Device::create(options));
  TexturePool staged_pool(*staged_device, uint64_t{1} << 30, real_clock());
  ASSERT_OK_AND_ASSIGN(auto staged, Renderer::create(*staged_device, staged_pool));
  const WireFrame frame = natural(67, 33);
  for (int round = 0; round < 2; ++round) {
    ASSERT_OK_AND_ASSIGN(auto here,
                         render_on(renderer_with(ExecutorKind::kDevice), frame, with(v1::TONE_CURVE_ACES_1)));
    ASSERT_OK_AND_ASSIGN(auto there, render_on(*staged, frame, with(v1::TONE_CURVE_ACES_1)));
    EXPECT_EQ(image(here.memory), image(there.memory));
  }
}

TEST_F(Table, Aces1AgreesWithThePublishedRenders) {
  if (data_folder().empty()) GTEST_SKIP() << "no test images; set CANDELA_DATA";
  const fs::path data = data_folder();
  struct Case {
    const char* input;
    const char* render;
    bool ap0;  // the file is AP0 but does not say so
    double max = 1.0;
  };
  const Case cases[] = {{"exr/Carrots.exr", "Carrots", false, 1.2},
                        {"exr/StillLife.exr", "StillLife", false},
                        // Noise far outside of AP1.
                        {"exr/Desk.exr", "Desk", false, 3.5},
                        {"exr/GoldenGate.exr", "GoldenGate", false},
                        {"exr/GrayRampsDiagonal.exr", "GrayRampsDiagonal", false},
                        {"exr/WideColorGamut.exr", "WideColorGamut", false, 2.3},
                        {"exr/Flowers.exr", "Flowers", false},
                        {"aces/target_ricd_190spectra.exr", "target_ricd_190spectra", true},
                        {"aces/ACES2065-1_ColorChecker2005.exr", "ColorChecker2005", true}};
  print_header("aces-1, codes beyond the file's own rounding");
  for (const Case& c : cases) {
    ASSERT_OK_AND_ASSIGN(const Image input, read_image(data / c.input));
    const Png png = read_png(data / "aces" / (std::string(c.render) + ".aces1_srgb.png"));
    ASSERT_EQ(png.width, input.width) << c.render;
    ASSERT_EQ(png.height, input.height) << c.render;
    v1::Settings settings = plain();
    settings.set_curve(v1::TONE_CURVE_ACES_1);
    settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
    if (c.ap0 && !input.chromaticities) settings.set_input_primaries(v1::PRIMARIES_ACES_AP0);
    settings.MergeFrom(settings_of(input));
    ASSERT_OK_AND_ASSIGN(auto rendered, render(frame_of(input), settings));
    const double most = png.depth == 16 ? 65535 : 255, half_code = 255 / most / 2;
    std::vector<float> codes;
    for (uint32_t y = 0; y < png.height; ++y) {
      const std::byte* row = rendered.memory.output_row(y).data();
      for (uint32_t x = 0; x < png.width; ++x) {
        for (size_t k = 0; k < 3; ++k) {
          uint16_t value;
          std::memcpy(&value, row + 8 * x + 2 * k, sizeof value);
          const double code = png.code(x, y, static_cast<int>(k));
          const double off = std::abs(value / 65535.0 - code / most) * 255.0 - half_code;
          codes.push_back(static_cast<float>(std::max(off, 0.0)));
        }
      }
    }
    ASSERT_FALSE(codes.empty()) << c.render;
    double sum = 0.0;
    for (float code : codes) sum += code;
    std::sort(codes.begin(), codes.end());
    const double p999 = codes[static_cast<size_t>(static_cast<double>(codes.size() - 1) * 0.999)];
    std::printf("%-44s %9.5f %9.5f %9.6f\n", c.render, codes.back(), p999,
                sum / static_cast<double>(codes.size()));
    EXPECT_LE(codes.back(), c.max) << c.render;
    EXPECT_LE(p999, 0.6) << c.render;
  }
}

}  // namespace
}  // namespace candela::testing
