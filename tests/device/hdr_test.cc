// Images for HDR displays, as the executors make them: against the float64 reference, published values and
// OpenColorIO's own.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "absl/strings/str_format.h"
#include "proto/candela/v1/settings.h"
#include "tests/support/device_fixture.h"
#include "tests/support/files.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela::testing {
namespace {

using Color = std::array<float, 3>;
using Values = std::array<double, 3>;

constexpr ExecutorKind kExecutors[] = {ExecutorKind::kHost, ExecutorKind::kDevice};
constexpr uint32_t kWidth = 61;

// At an exposure of 1 and without bloom.
v1::Settings hdr(v1::Transfer transfer, v1::ToneCurve curve, double peak_nits, v1::Primaries display) {
  v1::Settings settings = plain();
  settings.clear_output_format();
  settings.set_transfer(transfer);
  settings.set_curve(curve);
  settings.set_peak_nits(peak_nits);
  settings.set_display_primaries(display);
  return settings;
}

// Any light of 2^-14 .. 2^8, saturated light, light on the faces of the cube, greys, black, and light beyond
// every peak.
std::vector<Color> hdr_colors(size_t count) {
  std::mt19937_64 random(5);
  const auto uniform = [&random](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  std::vector<Color> colors(count);
  for (size_t i = 0; i < count; ++i) {
    const double light = std::exp2(uniform(-14, 8));
    for (float& v : colors[i]) v = static_cast<float>(light * std::exp2(uniform(i % 3 == 0 ? -20 : -4, 0)));
    if (i % 3 == 2) colors[i][i / 3 % 3] = 0;
    if (i % 8 == 7) colors[i].fill(static_cast<float>(light));
  }
  colors[1] = {};
  colors[2] = {65504, 65504, 65504};
  colors[3] = {1e9f, 0, 0};
  return colors;
}

double pq_nits(double signal) {
  const double p = std::pow(signal, 32 / 2523.0);
  return 10000 * std::pow(std::max(p - 107 / 128.0, 0.0) / (2413 / 128.0 - 2392 / 128.0 * p), 16384 / 2610.0);
}

double pq_signal(double nits) {
  const double y = std::pow(std::max(nits, 0.0) / 10000, 2610 / 16384.0);
  return std::pow((107 / 128.0 + 2413 / 128.0 * y) / (1 + 2392 / 128.0 * y), 2523 / 32.0);
}

// How far a colour's signals are from those wanted, and for PQ from those of light that differs by 2e-6 of
// the colour's largest: OpenColorIO's float32 leaves that much.
double beyond_roundings(const Values& made, const Values& wanted, bool hlg) {
  const double rounding = hlg ? 0 : 2e-6 * pq_nits(*std::max_element(wanted.begin(), wanted.end()));
  double worst = 0;
  for (size_t k = 0; k < 3; ++k) {
    const double want = std::clamp(wanted[k], 0.0, 1.0);
    const double low = hlg ? want : pq_signal(pq_nits(want) - rounding);
    const double high = hlg ? want : pq_signal(pq_nits(want) + rounding);
    worst = std::max({worst, low - made[k], made[k] - high});
  }
  return worst;
}

class Hdr : public DeviceTest {
 protected:
  static Rendered must(ExecutorKind kind, const WireFrame& frame, const v1::Settings& settings,
                       Verify verify = Verify::kNo) {
    auto rendered = render_on(renderer_with(kind), frame, settings, {}, verify);
    if (!rendered.ok()) throw std::runtime_error(rendered.status().ToString());
    return *std::move(rendered);
  }

  // The signals of a chart's colours.
  static std::vector<Values> signals(ExecutorKind kind, const std::vector<Color>& colors,
                                     const v1::Settings& settings) {
    const Rendered rendered = must(kind, chart_of(colors, kWidth), settings);
    std::vector<Values> out(colors.size());
    for (size_t i = 0; i < colors.size(); ++i) {
      const std::byte* const texel =
          rendered.memory.output_row(static_cast<uint32_t>(i / kWidth)).data() + i % kWidth * 8;
      for (size_t k = 0; k < 3; ++k) {
        uint16_t code;
        std::memcpy(&code, texel + 2 * k, sizeof code);
        out[i][k] = code / 65535.0;
      }
    }
    return out;
  }

  static nlohmann::json data(const char* name) {
    return nlohmann::json::parse(read_file(data_folder() + "/aces2/" + name));
  }
};

TEST_F(Hdr, IsWithinItsBoundOfFloat64) {
  const WireFrame frame = chart_of(hdr_colors(15000), kWidth);
  std::printf("codes of 1023 from float64: max, p99.9, mean\n");
  for (const v1::ToneCurve curve : {v1::TONE_CURVE_LINEAR, v1::TONE_CURVE_BT2390, v1::TONE_CURVE_ACES_2}) {
    for (const v1::Transfer transfer : {v1::TRANSFER_PQ, v1::TRANSFER_HLG}) {
      for (const v1::Primaries display : {v1::PRIMARIES_REC2020, v1::PRIMARIES_P3_D65}) {
        for (const double peak : {500.0, 1000.0, 4000.0}) {
          if (transfer == v1::TRANSFER_HLG && peak > 2000) continue;
          for (const v1::Primaries input : {v1::PRIMARIES_REC709, v1::PRIMARIES_REC2020}) {
            for (const ExecutorKind kind : kExecutors) {
              v1::Settings settings = hdr(transfer, curve, peak, display);
              settings.set_input_primaries(input);
              // So the result says the bound.
              if (curve != v1::TONE_CURVE_ACES_2) settings.set_max_error_codes(254);
              const Rendered rendered = must(kind, frame, settings, Verify::kYes);
              const Verification& d = rendered.report.verification->rounded;
              const double scale = 1023.0 / 255;
              const std::string what =
                  absl::StrFormat("%s %s %s %g, of %s, %s", v1::word_of(curve), v1::word_of(transfer),
                                  v1::word_of(display), peak, v1::word_of(input), executor_word(kind));
              std::printf("%-48s %8.4f %8.4f %8.5f\n", what.c_str(), d.max_codes * scale,
                          d.p999_codes * scale, d.mean_codes * scale);
              // Where Rec.2020 goes through Rec.709 and back, a component of 0 keeps float32's roundings of
              // the others, which PQ enlarges.
              const bool cancels = input == display && curve != v1::TONE_CURVE_ACES_2;
              EXPECT_LE(d.max_codes * scale, curve == v1::TONE_CURVE_ACES_2 ? 1.0
                                             : cancels                      ? 7.0
                                                                            : 0.03)
                  << what;
              // The reference itself has 0, and the picture that is compared is of float32.
              EXPECT_LE(d.max_codes, rendered.report.error_bound.value_or(255) + 1e-5) << what;
              EXPECT_LE(d.mean_codes * scale, cancels ? 0.01 : 1.5e-3) << what;
            }
          }
        }
      }
    }
  }
}

// A grey or colour of the display, in nit, and its signal.
struct Published {
  Values nits;
  Values signal;
};

TEST_F(Hdr, HasThePublishedSignals) {
  const auto grey = [](double nits, double signal) {
    return Published{{nits, nits, nits}, {signal, signal, signal}};
  };
  // SMPTE ST 2084 and ITU-R BT.2100, computed in double precision.
  const std::vector<Published> pq = {
      grey(1, .149945732),       grey(100, .508078421517),
      grey(203, .580688881042),  grey(1000, .751827096247),
      grey(4000, .902572393311), grey(10000, 1),
      {{0, 0, 0}, {0, 0, 0}},    {{1000, 100, 1}, {.751827096, .508078422, .149945732}}};
  const std::vector<Published> hlg = {grey(203.152, .75),
                                      grey(1000, 1),
                                      {{175.46004, 55.18391, 13.79598}, {.75, .5, .25}},
                                      // Of the largest signal they would have 765, 925 and 568 nit.
                                      {{1000, 0, 0}, {1, 0, 0}},
                                      {{0, 1000, 0}, {0, 1, 0}},
                                      {{0, 0, 1000}, {0, 0, 1}}};
  for (const ExecutorKind kind : kExecutors) {
    for (const auto& [transfer, peak, values] :
         {std::tuple(v1::TRANSFER_PQ, 10000.0, pq), std::tuple(v1::TRANSFER_HLG, 1000.0, hlg)}) {
      v1::Settings settings = hdr(transfer, v1::TONE_CURVE_LINEAR, peak, v1::PRIMARIES_REC2020);
      settings.set_input_primaries(v1::PRIMARIES_REC2020);
      std::vector<Color> colors;
      for (const Published& one : values) {
        Color& c = colors.emplace_back();
        for (size_t k = 0; k < 3; ++k) c[k] = static_cast<float>(one.nits[k] / 203);
      }
      const std::vector<Values> made = signals(kind, colors, settings);
      for (size_t i = 0; i < values.size(); ++i) {
        for (size_t k = 0; k < 3; ++k) {
          // A 16-bit code, or what float32 leaves of a component in another's shadow.
          const double tolerance = values[i].signal[k] == 0 ? 0.03 : 1.0 / 65535;
          EXPECT_NEAR(made[i][k], values[i].signal[k], tolerance)
              << v1::word_of(transfer) << " " << values[i].nits[k] << " " << executor_word(kind);
        }
      }
    }
  }
}

TEST_F(Hdr, Bt2390HasThePublishedRollOff) {
  struct Case {
    double source, peak;
    Values nits, shown;
  };
  const auto grey = [](double nits, double shown) {
    return Case{1000, 100, {nits, nits, nits}, {shown, shown, shown}};
  };
  for (const Case& one :
       {grey(10, 10), grey(50, 46.142955), grey(100, 69.454403), grey(203, 88.243641), grey(500, 98.946871),
        grey(1000, 100), Case{4000, 600, {1000, 100, 10}, {537.36942, 53.73694, 5.37369}},
        Case{1000, 1000, {1000, 100, 10}, {1000, 100, 10}},
        Case{10000, 10000, {203, 100, 1e5}, {203 * 0.1, 100 * 0.1, 10000}}}) {
    for (const ExecutorKind kind : kExecutors) {
      v1::Settings settings = hdr(v1::TRANSFER_PQ, v1::TONE_CURVE_BT2390, one.peak, v1::PRIMARIES_REC2020);
      settings.set_source_peak_nits(one.source);
      settings.set_input_primaries(v1::PRIMARIES_REC2020);
      Color c;
      for (size_t k = 0; k < 3; ++k) c[k] = static_cast<float>(one.nits[k] / 203);
      const Values made = signals(kind, {c}, settings)[0];
      for (size_t k = 0; k < 3; ++k) {
        EXPECT_NEAR(pq_nits(made[k]), one.shown[k], 3e-4 * one.shown[k])
            << one.source << " to " << one.peak << ", " << one.nits[k] << " nit, " << executor_word(kind);
      }
    }
  }
}

// A signal of 10 bits of which light is made, and that is shown as it is, is the same signal.
TEST_F(Hdr, APqSignalComesBack) {
  v1::Settings settings = hdr(v1::TRANSFER_PQ, v1::TONE_CURVE_LINEAR, 10000, v1::PRIMARIES_REC2020);
  settings.set_input_primaries(v1::PRIMARIES_REC2020);
  std::vector<Color> colors;
  std::vector<std::array<int, 3>> codes;
  std::mt19937 random(2);
  for (int i = 0; i < 1024 + 4000; ++i) {
    const auto any = [&] { return static_cast<int>(random() % 1024); };
    const std::array<int, 3> code = i < 1024 ? std::array{i, i, i} : std::array{any(), any(), any()};
    codes.push_back(code);
    Color& c = colors.emplace_back();
    for (size_t k = 0; k < 3; ++k) c[k] = static_cast<float>(pq_nits(code[k] / 1023.0) / 203);
  }
  for (const ExecutorKind kind : kExecutors) {
    const std::vector<Values> made = signals(kind, colors, settings);
    double worst = 0;
    for (size_t i = 0; i < codes.size(); ++i) {
      for (size_t k = 0; k < 3; ++k) {
        const double off = std::abs(std::round(made[i][k] * 1023) - codes[i][k]);
        if (i < 1024) {
          EXPECT_EQ(off, 0) << codes[i][k] << " " << executor_word(kind);
        }
        worst = std::max(worst, off);
      }
    }
    std::printf("any colour comes back within %g codes, %s\n", worst, executor_word(kind));
    EXPECT_LE(worst, 4);
  }
}

// MaxCLL and MaxFALL, by every executor and tier, of an image with an odd size and of a resized one.
TEST_F(Hdr, SaysHowBrightTheImageIs) {
  const WireFrame frame = chart_of(hdr_colors(61 * 37), kWidth);
  for (const v1::ToneCurve curve : {v1::TONE_CURVE_LINEAR, v1::TONE_CURVE_BT2390, v1::TONE_CURVE_ACES_2}) {
    for (const uint32_t width : {0u, 40u}) {
      v1::Settings settings = hdr(v1::TRANSFER_PQ, curve, 1000, v1::PRIMARIES_P3_D65);
      settings.set_input_primaries(v1::PRIMARIES_ACES_AP1);
      if (width > 0) settings.mutable_output_size()->set_width(width);
      settings.set_tier("reference");
      const Rendered truth = must(ExecutorKind::kHost, frame, settings);
      settings.set_tier("standard");
      for (const ExecutorKind kind : kExecutors) {
        const Rendered rendered = must(kind, frame, settings);
        ASSERT_TRUE(rendered.report.shown.has_value());
        EXPECT_NEAR(rendered.report.shown->largest, truth.report.shown->largest, 1e-4);
        EXPECT_NEAR(rendered.report.shown->mean, truth.report.shown->mean, 5e-5);
        EXPECT_LE(rendered.report.shown->largest, 1);
        EXPECT_GT(rendered.report.shown->mean, 1e-3);
        // The largest code stands for the largest light.
        const std::vector<std::byte> pixels = image(rendered.memory);
        double largest = 0;
        for (size_t i = 0; i < pixels.size() / 2; ++i) {
          uint16_t code;
          std::memcpy(&code, pixels.data() + 2 * i, sizeof code);
          if (i % 4 < 3) largest = std::max(largest, pq_nits(code / 65535.0));
        }
        EXPECT_NEAR(1000 * rendered.report.shown->largest, largest, 1e-3 * largest);
      }
    }
  }
  const Rendered sdr = must(ExecutorKind::kHost, frame, plain());
  EXPECT_FALSE(sdr.report.shown.has_value());
}

// Frames of nothing, of all light, of NaN and infinities, and of one light.
TEST_F(Hdr, HardCasesStayInRange) {
  const float kInf = std::numeric_limits<float>::infinity();
  const float kNan = std::numeric_limits<float>::quiet_NaN();
  for (const float value : {0.0f, 1e-30f, 49.26f, 65504.0f, 1e30f, -1.0f, kInf, kNan}) {
    for (const v1::Transfer transfer : {v1::TRANSFER_PQ, v1::TRANSFER_HLG}) {
      for (const v1::ToneCurve curve :
           {v1::TONE_CURVE_LINEAR, v1::TONE_CURVE_BT2390, v1::TONE_CURVE_ACES_2}) {
        for (const ExecutorKind kind : kExecutors) {
          const v1::Settings settings = hdr(transfer, curve, 1000, v1::PRIMARIES_REC2020);
          const WireFrame frame = make_frame(65, 3, v1::PIXEL_FORMAT_RGBA32F, [&](uint32_t x, uint32_t) {
            return x == 7 ? Texel{value, 0, 0, 1} : Texel{value, value, value, 1};
          });
          const Rendered rendered = must(kind, frame, settings, Verify::kYes);
          EXPECT_LE(rendered.report.verification->rounded.max_codes, 0.25)
              << value << " " << v1::word_of(transfer) << " " << v1::word_of(curve) << " "
              << executor_word(kind);
          EXPECT_GE(rendered.report.shown->largest, 0);
          EXPECT_LE(rendered.report.shown->mean, rendered.report.shown->largest + 4e-5);
        }
      }
    }
  }
}

// 558 colours inside of AP1, through each built-in transform that a display of these settings has.
TEST_F(Hdr, Aces2IsThatOfOpenColorIO) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data; set CANDELA_DATA";
  const nlohmann::json points = data("points.json");
  const auto colors = points["aces2065_1"].get<std::vector<Color>>();
  int compared = 0;
  const nlohmann::json expected = data("expected.json");
  for (const nlohmann::json& output : expected["outputs"]) {
    const std::string name = output["builtin"];
    for (const double peak : {500.0, 1000.0, 2000.0, 4000.0}) {
      for (const v1::Primaries limit : {v1::PRIMARIES_P3_D65, v1::PRIMARIES_REC2020}) {
        const std::string limit_word = limit == v1::PRIMARIES_P3_D65 ? "P3-D65" : "REC2020";
        if (name.find(absl::StrFormat(" HDR-%gnit-%s_2.0", peak, limit_word)) == std::string::npos) continue;
        for (const auto& [word, wanted] : output["displays"].items()) {
          const bool p3 =
              word.find("P3-D65") != std::string::npos && word.find("ST2084") != std::string::npos;
          const bool hlg = word.find("HLG") != std::string::npos;
          v1::Settings settings = hdr(hlg ? v1::TRANSFER_HLG : v1::TRANSFER_PQ, v1::TONE_CURVE_ACES_2, peak,
                                      p3 ? v1::PRIMARIES_P3_D65 : v1::PRIMARIES_REC2020);
          settings.set_limit_primaries(limit);
          settings.set_input_primaries(v1::PRIMARIES_ACES_AP0);
          for (const ExecutorKind kind : kExecutors) {
            const std::vector<Values> made = signals(kind, colors, settings);
            double worst = 0;
            for (size_t i = 0; i < colors.size(); ++i) {
              if (points["inside_ap1"][i] == 0) continue;
              // OpenColorIO's OOTF of HLG takes no luminance below 1e-4 of the peak.
              if (hlg && output["xyz"][i][1] < 1.2e-3) continue;
              worst = std::max(worst, 1023 * beyond_roundings(made[i], wanted[i].get<Values>(), hlg));
            }
            std::printf("%4.0f nit in %s, %s: at most %.3f codes of 1023, %s\n", peak, limit_word.c_str(),
                        word.c_str(), worst, executor_word(kind));
            EXPECT_LE(worst, hlg ? 0.3 : 0.1) << name << " " << word;
            ++compared;
          }
        }
      }
    }
  }
  EXPECT_EQ(compared, 2 * 14);
}

// Gain maps beside SDR images, as the executors make them.

v1::Settings with_map(v1::ToneCurve curve, double peak_nits = 1000) {
  v1::Settings settings = plain();
  settings.set_curve(curve);
  settings.set_gain_map_peak_nits(peak_nits);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA8);
  return settings;
}

const GainCurve& curve_of(const v1::Settings& settings) {
  static std::vector<std::shared_ptr<const GainCurve>> kept;
  return *kept.emplace_back(Settings::from(settings).value().gain_curve());
}

class GainMap : public DeviceTest {};

TEST(GainCurve, HasThePublishedShoulders) {
  struct Case {
    v1::ToneCurve curve;
    double steepest, shoulder;
  };
  for (const Case& one :
       {Case{v1::TONE_CURVE_ACES_HILL, .750526, .4574}, Case{v1::TONE_CURVE_ACES_NARKOWICZ, 1.502841, .2222},
        Case{v1::TONE_CURVE_AGX, 1.316959, .0892}, Case{v1::TONE_CURVE_LINEAR, 1, 1}}) {
    const GainCurve& curve = curve_of(with_map(one.curve));
    EXPECT_NEAR(curve.steepest(), one.steepest, 1e-4) << v1::word_of(one.curve);
    if (one.curve != v1::TONE_CURVE_LINEAR) {
      EXPECT_NEAR(curve.shoulder(), one.shoulder, 0.012 * one.shoulder);
    }
  }
}

double pq_of(double nits) {
  const double y = std::pow(nits / 10000, 2610 / 16384.0);
  return std::pow((107 / 128.0 + 2413 / 128.0 * y) / (1 + 2392 / 128.0 * y), 2523 / 32.0);
}

double nits_of(double pq) {
  const double p = std::pow(pq, 32 / 2523.0);
  return 10000 * std::pow(std::max(p - 107 / 128.0, 0.0) / (2413 / 128.0 - 2392 / 128.0 * p), 16384 / 2610.0);
}

// The page's formula again, for aces-hill at 1000 nit. Greys stay grey but for the last digits of its
// matrices.
TEST(GainCurve, IsTheFormulaOfThePage) {
  const GainCurve& curve = curve_of(with_map(v1::TONE_CURVE_ACES_HILL));
  const double most = pq_of(1000), knee = 1.5 * most - 0.5;
  for (const double n : {0.3, 0.5, 0.7, 1.0, 2.0, 5.0, 9.0, 20.0, 60.0, 500.0}) {
    const double sdr = (n * (n + 0.0245786) - 0.000090537) / (n * (0.983729 * n + 0.4329510) + 0.238081);
    double hdr = .750526 * n * 203;
    if (const double e = std::min(pq_of(std::min(hdr, 1e4)), 1.0); e >= knee) {
      const double t = (e - knee) / (1 - knee);
      hdr = nits_of((1 + 2 * t) * (1 - t) * (1 - t) * knee + t * (1 - t) * (1 - t) * (1 - knee) +
                    t * t * (3 - 2 * t) * most);
    }
    const double gain = n > .4574 ? std::max(0.0, std::log2(hdr / 203 / std::min(sdr, 1.0))) : 0;
    EXPECT_NEAR(curve.log2_gain(n), gain, 2e-3) << n;
  }
}

// A film's black is above 0, and so is that of many looks: the dark keeps its SDR light all the same.
TEST(GainCurve, ALiftedBlackOpensNoShadows) {
  std::vector<float> rgb = lattice_light(33, shader::AXES_REC709, 32);
  for (float& v : rgb) v = 0.01f + 0.95f * std::max(v, 0.0f) / (std::max(v, 0.0f) + 0.6f);
  v1::Settings settings = with_map(v1::TONE_CURVE_TABLE);
  *settings.mutable_table() = to_message(make_color_table(33, shader::AXES_REC709, 32, rgb));
  const GainCurve& curve = curve_of(settings);
  EXPECT_LE(curve.log2_gain(0.01), 0.1);
  EXPECT_LE(curve.log2_gain(0.18), 0.5);
  EXPECT_GT(curve.log2_gain(20), 1.5);
  EXPECT_LE(curve.max_log2(), std::log2(1000 / 203.0) + 0.3);
}

// It begins at 0, never falls on the way up to where the curve is flat, and ends at the display's peak.
TEST(GainCurve, EndsAtTheDisplaysPeak) {
  for (const double peak : {203.0, 400.0, 1000.0, 10000.0}) {
    const GainCurve& curve = curve_of(with_map(v1::TONE_CURVE_ACES_HILL, peak));
    EXPECT_EQ(curve.log2_gain(0), 0);
    EXPECT_EQ(curve.log2_gain(0.9 * curve.shoulder()), 0);
    EXPECT_NEAR(curve.max_log2(), std::max(std::log2(peak / 203), 1.0 / 64), 0.02) << peak;
    EXPECT_NEAR(curve.log2_gain(1e30), std::log2(peak / 203), 0.02) << peak;
    double before = 0;
    for (double n = 0.01; n < 30; n *= 1.01) {
      EXPECT_GE(curve.log2_gain(n), before - 1e-3) << n;
      before = curve.log2_gain(n);
    }
  }
}

// Light of a brighter display that the HDR display can show, too, is what the map leads to.
TEST(GainCurve, OpensAShoulderToTheSourcesOwnLight) {
  for (const v1::ToneCurve shown : {v1::TONE_CURVE_SHOULDER, v1::TONE_CURVE_BT2390}) {
    v1::Settings settings = with_map(shown);
    settings.set_source_peak_nits(900);
    const GainCurve& curve = curve_of(settings);
    for (const double n : {0.02, 0.4, 1.0, 2.0, 4.4}) {
      const double sdr = reference::tone_curve(static_cast<uint32_t>(shown), {n, n, n}, 900 / 203.0)[1];
      EXPECT_NEAR(std::exp2(curve.log2_gain(n)) * sdr, n, 2e-3 * n) << v1::word_of(shown) << " " << n;
    }
  }
}

TEST_F(GainMap, IsWithinHalfACodeAndTheImageIsThatWithoutIt) {
  const WireFrame frame = make_frame(131, 67, v1::PIXEL_FORMAT_RGBA32F, [](uint32_t x, uint32_t y) -> Texel {
    const float light = std::exp2(static_cast<float>(x) / 8.0f - 8.0f);
    return {light, light * static_cast<float>(y) / 66.0f, light / 3.0f, y % 2 == 0 ? 1.0f : 0.5f};
  });
  for (const v1::ToneCurve curve :
       {v1::TONE_CURVE_ACES_HILL, v1::TONE_CURVE_LINEAR, v1::TONE_CURVE_REINHARD, v1::TONE_CURVE_AGX,
        v1::TONE_CURVE_ACES_1, v1::TONE_CURVE_ACES_2, v1::TONE_CURVE_BT2390, v1::TONE_CURVE_SHOULDER}) {
    v1::Settings settings = with_map(curve);
    const GainCurve& truth = curve_of(settings);
    v1::Settings without = settings;
    without.clear_gain_map_peak_nits();
    for (const ExecutorKind kind : {ExecutorKind::kHost, ExecutorKind::kDevice}) {
      for (const char* tier : {"standard", "reference"}) {
        settings.set_tier(tier);
        without.set_tier(tier);
        const auto rendered = render_on(renderer_with(kind), frame, settings);
        const auto plain_image = render_on(renderer_with(kind), frame, without);
        ASSERT_OK(rendered);
        ASSERT_OK(plain_image);
        ASSERT_NE(rendered->report.plan.gain, nullptr);
        const auto made = image(rendered->memory), other = image(plain_image->memory);
        double worst = 0;
        for (size_t i = 0; i < made.size(); ++i) {
          if (i % 4 < 3) {
            ASSERT_EQ(made[i], other[i]) << v1::word_of(curve) << " " << i;
            continue;
          }
          const auto x = static_cast<uint32_t>(i / 4 % 131), y = static_cast<uint32_t>(i / 4 / 131);
          const double light = std::exp2(x / 8.0 - 8.0);
          const double largest = std::max({light, light * y / 66.0, light / 3});
          worst = std::max(worst, std::abs(std::to_integer<int>(made[i]) -
                                           255 * std::min(1.0, truth.log2_gain(largest) / truth.max_log2())));
        }
        EXPECT_LE(worst, 0.55) << v1::word_of(curve) << " " << executor_word(kind) << " " << tier;
      }
    }
  }
}

TEST_F(GainMap, WhatHasNoGainMapIsRefused) {
  const auto refusal = [](v1::Settings settings) {
    return std::string(Settings::from(settings).status().message());
  };
  v1::Settings settings = with_map(v1::TONE_CURVE_ACES_HILL);
  settings.set_output_format(v1::OUTPUT_FORMAT_RGBA16);
  EXPECT_TRUE(says(refusal(settings), "output_format is rgba16"));
  settings = with_map(v1::TONE_CURVE_ACES_HILL);
  settings.set_alpha(v1::ALPHA_STRAIGHT);
  EXPECT_TRUE(says(refusal(settings), "alpha is straight"));
  settings = with_map(v1::TONE_CURVE_ACES_HILL);
  settings.set_transfer(v1::TRANSFER_GAMMA22);
  EXPECT_TRUE(says(refusal(settings), "transfer is gamma22"));
  settings = with_map(v1::TONE_CURVE_ACES_HILL, 100);
  EXPECT_TRUE(says(refusal(settings), "gain_map_peak_nits is 100"));
}

}  // namespace
}  // namespace candela::testing
