// The curve aces-2 as the executors make it, against the float64 reference and OpenColorIO's own values.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "tests/support/device_fixture.h"
#include "tests/support/files.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

using Color = std::array<float, 3>;

v1::Settings aces_2_of(v1::Primaries primaries) {
  v1::Settings settings = plain();
  settings.set_curve(v1::TONE_CURVE_ACES_2);
  settings.set_input_primaries(primaries);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  return settings;
}

// Any light of 2^-12 .. 2^10, saturated light, light on the faces of the primaries' cube, and greys.
std::vector<Color> hostile_colors(size_t count) {
  std::mt19937_64 random(3);
  const auto uniform = [&random](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  std::vector<Color> colors(count);
  for (size_t i = 0; i < count; ++i) {
    const double light = std::exp2(uniform(-12, 10));
    for (float& v : colors[i]) {
      const double part = i % 3 == 0   ? std::exp2(uniform(-12, 0))
                          : i % 3 == 1 ? std::exp2(uniform(-20, 0))
                                       : uniform(0, 1);
      v = static_cast<float>(light * part);
    }
    if (i % 3 == 2) colors[i][i / 3 % 3] = 0;
    if (i % 8 == 7) colors[i].fill(static_cast<float>(light));
  }
  return colors;
}

class Aces2Passes : public DeviceTest {
 protected:
  // The largest distance of the image's R, G and B from display signals, in codes of 255, over `counted`.
  static double codes_off(const std::vector<Color>& colors, v1::Primaries primaries,
                          const nlohmann::json& signals, const nlohmann::json& counted) {
    constexpr uint32_t kWidth = 61;
    const auto rendered = render(chart_of(colors, kWidth), aces_2_of(primaries));
    EXPECT_OK(rendered);
    if (!rendered.ok()) return INFINITY;
    double worst = 0;
    for (size_t i = 0; i < colors.size(); ++i) {
      if (!counted.empty() && counted[i] == 0) continue;
      const std::byte* const texel =
          rendered->memory.output_row(static_cast<uint32_t>(i / kWidth)).data() + i % kWidth * 8;
      for (size_t k = 0; k < 3; ++k) {
        uint16_t code;
        std::memcpy(&code, texel + 2 * k, sizeof code);
        const double want = std::clamp(signals[i][k].get<double>(), 0.0, 1.0);
        worst = std::max(worst, 255 * std::abs(code / 65535.0 - want));
      }
    }
    return worst;
  }

  static nlohmann::json data(const char* name) {
    return nlohmann::json::parse(read_file(data_folder() + "/aces2/" + name));
  }
};

TEST_F(Aces2Passes, AreWithinTheirBoundOfFloat64) {
  const std::vector<Color> colors = hostile_colors(300 * 200);
  struct Case {
    v1::Primaries primaries;
    v1::Transfer transfer;
    double bound;
  };
  std::printf("aces-2 against float64, codes: max, p99.9, mean\n");
  for (const Case& one : {Case{v1::PRIMARIES_REC709, v1::TRANSFER_SRGB, 0.04},
                          Case{v1::PRIMARIES_REC709, v1::TRANSFER_GAMMA22, 1.5},
                          Case{v1::PRIMARIES_REC709, v1::TRANSFER_LINEAR, 0.05},
                          Case{v1::PRIMARIES_ACES_AP1, v1::TRANSFER_SRGB, 0.3},
                          Case{v1::PRIMARIES_ACES_AP1, v1::TRANSFER_GAMMA22, 3},
                          Case{v1::PRIMARIES_ACES_AP1, v1::TRANSFER_LINEAR, 0.08}}) {
    v1::Settings settings = aces_2_of(one.primaries);
    settings.set_transfer(one.transfer);
    for (const ExecutorKind kind : {ExecutorKind::kHost, ExecutorKind::kDevice}) {
      const auto rendered = render_on(renderer_with(kind), chart_of(colors, 300), settings, {}, Verify::kYes);
      ASSERT_OK(rendered);
      const Verification& d = rendered->report.verification->rounded;
      std::printf("%-8s %-8s %-7s %8.4f %8.4f %8.5f\n", v1::word_of(one.primaries).c_str(),
                  v1::word_of(one.transfer).c_str(), executor_word(kind), d.max_codes, d.p999_codes,
                  d.mean_codes);
      EXPECT_LE(d.max_codes, one.bound) << v1::word_of(one.primaries) << " " << v1::word_of(one.transfer);
      EXPECT_LE(d.p999_codes, 0.01);
    }
  }
}

// The image has 16 bits. Light of Rec.709 is rounded to halves, which these colours hardly show.
TEST_F(Aces2Passes, AreWithinATenthOfACodeOfOpenColorIO) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data; set CANDELA_DATA";
  const nlohmann::json points = data("points.json");
  const auto colors = points["aces2065_1"].get<std::vector<Color>>();
  const nlohmann::json expected = data("expected.json");
  for (const nlohmann::json& output : expected["outputs"]) {
    if (output["builtin"] != "ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-100nit-REC709_2.0") continue;
    const nlohmann::json& signals = output["displays"]["DISPLAY - CIE-XYZ-D65_to_sRGB"];
    const double worst = codes_off(colors, v1::PRIMARIES_ACES_AP0, signals, points["inside_ap1"]);
    const double outside = codes_off(colors, v1::PRIMARIES_ACES_AP0, signals, {});
    std::printf("%zu colours: at most %.3f codes inside of AP1, %.3f with those outside\n", colors.size(),
                worst, outside);
    EXPECT_LE(worst, 0.1);
    EXPECT_LE(outside, 0.1);
    EXPECT_GT(worst, 0.01) << "nothing was compared";
    return;
  }
  FAIL() << "no such output";
}

TEST_F(Aces2Passes, ShowTheConfigurationsView) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data; set CANDELA_DATA";
  const nlohmann::json config = data("config_views.json");
  const auto colors = config["inputs"].get<std::vector<Color>>();
  int views = 0;
  for (const nlohmann::json& view : config["views"]) {
    if (view["view"] != "ACES 2.0 - SDR 100 nits (Rec.709)") continue;
    const std::string space = view["colorspace"];
    const v1::Primaries primaries = space == "ACES2065-1" ? v1::PRIMARIES_ACES_AP0
                                    : space == "ACEScg"   ? v1::PRIMARIES_ACES_AP1
                                                          : v1::PRIMARIES_REC709;
    const double worst = codes_off(colors, primaries, view["rgb"], {});
    std::printf("%s: at most %.3f codes\n", space.c_str(), worst);
    EXPECT_LE(worst, 0.1) << space;
    ++views;
  }
  EXPECT_EQ(views, 3);
}

}  // namespace
}  // namespace candela::testing
