// The ACES transforms, wide tables, Candela's own powers, and HDR displays, against published values.
#include <OpenColorIO/OpenColorIO.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "server/render/color/aces.h"
#include "server/render/color/aces2.h"
#include "server/render/color/hdr_signal.h"
#include "server/render/color/portable_math.h"
#include "server/render/color/primaries.h"
#include "server/render/settings/hdr_display.h"
#include "server/render/settings/settings.h"
#include "shaders/reference.h"
#include "tests/support/files.h"
#include "tests/support/status.h"
#include "tests/support/wide_gamut.h"

namespace candela {
namespace {

namespace ocio = OCIO_NAMESPACE;

using reference::Rgb;
using Color = std::array<float, 3>;

constexpr float kTableEnd = 32.0f;

Rgb aces(const Rgb& c) {
  Color rgb = {static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2])};
  EXPECT_OK(aces_1(rgb));
  return {rgb[0], rgb[1], rgb[2]};
}

double srgb(double light) { return reference::transfer(shader::TRANSFER_SRGB, std::clamp(light, 0.0, 1.0)); }

std::optional<nlohmann::json> data(const char* file) {
  if (data_folder().empty()) return std::nullopt;
  return nlohmann::json::parse(read_file(data_folder() + "/aces/" + file));
}

Color multiply(const std::array<float, 9>& m, const Color& v) {
  Color out{};
  for (size_t r = 0; r < 3; ++r) {
    for (size_t c = 0; c < 3; ++c) out[r] += m[3 * r + c] * v[c];
  }
  return out;
}

TEST(Aces1, HasItsPublishedValueAtOne) {
  for (double v : aces({1, 1, 1})) EXPECT_NEAR(v, 0.624316, 1e-6);
}

TEST(Aces1, IsFiniteUpToTheLargestExposedLight) {
  for (const Rgb& c : {Rgb{0x1p60, 0x1p60, 0x1p60}, Rgb{0x1p60, 0, 0}, Rgb{0, 0x1p60, 1e-9}, Rgb{0, 0, 0}}) {
    for (double v : aces(c)) EXPECT_TRUE(std::isfinite(v));
  }
}

TEST(Aces1, AgreesWithPublishedPoints) {
  const std::optional<nlohmann::json> points = data("points.json");
  if (!points) GTEST_SKIP() << "no test data; set CANDELA_DATA";
  const auto& in = (*points)["input_linear_rec709"];
  const auto& out = (*points)["aces1_sdr_srgb_unclamped"];
  double worst = 0.0;
  for (size_t i = 0; i < in.size(); ++i) {
    const Rgb got = aces({in[i][0], in[i][1], in[i][2]});
    for (size_t k = 0; k < 3; ++k) {
      const double expected = std::clamp<double>(out[i][k], 0.0, 1.0);
      worst = std::max(worst, std::abs(srgb(got[k]) - expected) * 255.0);
    }
  }
  std::printf("%zu published points: at most %.5f codes off\n", in.size(), worst);
  // The published values have six digits and were computed with OpenColorIO's faster logarithms.
  EXPECT_LE(worst, 0.004);
}

TEST(Aces1, AgreesWithOpenColorIOsOwnTests) {
  const std::optional<nlohmann::json> expected = data("ocio_expected.json");
  if (!expected) GTEST_SKIP() << "no test data; set CANDELA_DATA";
  const auto ap0_to_rec709 = *matrix_to_rec709(chromaticities(v1::PRIMARIES_ACES_AP0));
  const auto ap1_to_rec709 = *matrix_to_rec709(chromaticities(v1::PRIMARIES_ACES_AP1));
  const auto xyz_to_rec709 = *matrix_to_rec709(chromaticities(v1::PRIMARIES_XYZ));
  ASSERT_TRUE(ap0_to_rec709 && ap1_to_rec709 && xyz_to_rec709);
  int checked = 0;
  for (const auto& item : (*expected)["cases"]) {
    const std::string name = item["transform"];
    const Color in = item["in"];
    const Color out = item["out"];
    // Everything is compared in Rec.709.
    Color got{};
    Color want = multiply(*xyz_to_rec709, out);
    if (name == "ACES-AP0 to CIE-XYZ-D65 (Bradford)") {
      got = multiply(*ap0_to_rec709, in);
    } else if (name == "ACES-AP1 to CIE-XYZ-D65 (Bradford)") {
      got = multiply(*ap1_to_rec709, in);
    } else if (name == "ACES-AP1 to linear Rec.709 (Bradford)") {
      got = multiply(*ap1_to_rec709, in);
      want = out;
    } else if (name == "ACEScg to ACES2065-1") {
      got = multiply(*ap1_to_rec709, in);
      want = multiply(*ap0_to_rec709, out);
    } else if (name == "ACES 1.0 SDR video: ACES2065-1 to display CIE-XYZ-D65") {
      const Color scene = multiply(*ap0_to_rec709, in);
      const Rgb light = aces({scene[0], scene[1], scene[2]});
      std::copy(light.begin(), light.end(), got.begin());
    } else {
      continue;
    }
    ++checked;
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(got[k], want[k], 2e-6) << name;
  }
  EXPECT_EQ(checked, 5);
}

TEST(Aces1, PrimariesAreOpenColorIOs) {
  const std::pair<const char*, v1::Primaries> cases[] = {
      {"UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD", v1::PRIMARIES_ACES_AP0},
      {"UTILITY - ACES-AP1_to_CIE-XYZ-D65_BFD", v1::PRIMARIES_ACES_AP1}};
  const auto xyz_to_rec709 = *matrix_to_rec709(chromaticities(v1::PRIMARIES_XYZ));
  for (const auto& [style, primaries] : cases) {
    const ocio::BuiltinTransformRcPtr builtin = ocio::BuiltinTransform::Create();
    builtin->setStyle(style);
    const auto processor = ocio::Config::CreateRaw()->getProcessor(builtin)->getDefaultCPUProcessor();
    const auto matrix = *matrix_to_rec709(chromaticities(primaries));
    for (size_t c = 0; c < 3; ++c) {
      Color column{};
      column[c] = 1.0f;
      processor->applyRGB(column.data());
      const Color rec709 = multiply(*xyz_to_rec709, column);
      for (size_t r = 0; r < 3; ++r) EXPECT_NEAR((*matrix)[3 * r + c], rec709[r], 2e-6) << style;
    }
  }
}

TEST(ColorTable, AxesBeginAtZeroEndAtTheirEndAndRise) {
  for (uint32_t size : {2u, 17u, 65u}) {
    for (float end : {1.0f, 31.0f, 32.0f, 65504.0f}) {
      EXPECT_EQ(table_axis_value(0, size, end), 0.0);
      EXPECT_EQ(table_axis_value(size - 1, size, end), end);
      for (uint32_t i = 1; i < size; ++i)
        EXPECT_GT(table_axis_value(i, size, end), table_axis_value(i - 1, size, end));
    }
  }
}

TEST(ColorTable, OctavesHaveNoStepInTheirSlopeAndAreNearLog2) {
  for (double x = 1.0; x < 1e5; x *= 1.001) EXPECT_NEAR(table_octaves(x), std::log2(x), 0.01);
  for (double x : {2.0, 4.0, 1024.0}) {
    const double h = x * 1e-6;
    EXPECT_NEAR((table_octaves(x + h) - table_octaves(x)) / (table_octaves(x) - table_octaves(x - h)), 1.0,
                1e-5);
  }
}

TEST(ColorTable, LightBeyondTheEndCountsAsTheEnd) {
  for (uint32_t axes : {shader::AXES_ACES, shader::AXES_REC709}) {
    std::vector<float> rgb = lattice_light(9, axes, 4.0f);
    for (float& v : rgb) v *= 0.25f;
    const ColorTable table = make_color_table(9, axes, 4.0f, rgb);
    const Rgb end = reference::look_up(table, {4, 4, 4});
    for (double v : end) EXPECT_NEAR(v, 1.0, 1e-4);
    const Rgb beyond = reference::look_up(table, {1e18, 1e18, 1e18});
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(beyond[k], end[k], 1e-4);
    for (double v : reference::look_up(table, {0, 0, 0})) EXPECT_EQ(v, 0.0);
  }
}

TEST(ColorTable, LightThatIsNotFiniteIsCut) {
  std::vector<float> light(24, NAN);
  light[0] = light[1] = light[2] = INFINITY;
  const ColorTable table = make_color_table(2, shader::AXES_ACES, 1.0f, light);
  EXPECT_NEAR(table.values.front(), 65535 * std::sqrt(1.5) / 1.25, 2.0);
  EXPECT_EQ(table.values.back(), 0);
}

TEST(ColorTable, LightWithinTheAxesIsAsTheTableSeesIt) {
  const ColorTable table = **aces_1_table(17);
  for (const Color& c : {Color{100, 1, 0.1f}, Color{0, 40, 1}, Color{0.5f, 0.25f, 1000}}) {
    const Color cut = light_within_axes(c, shader::AXES_ACES, kTableEnd);
    const Rgb a = reference::look_up(table, {c[0], c[1], c[2]});
    const Rgb b = reference::look_up(table, {cut[0], cut[1], cut[2]});
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(a[k], b[k], 1e-4);
  }
}

TEST(ColorTable, HoldsOpenColorIOsLightAtItsPoints) {
  constexpr uint32_t kSize = 17;
  ASSERT_OK_AND_ASSIGN(const auto table, aces_1_table(kSize));
  double worst = 0.0;
  // Only points of the lattice that are never negative in Rec.709.
  const auto inverse = [](const Rgb& v) {
    // Newton's method starts at the point itself, because the matrix is near the identity.
    static constexpr double kM[] = {TABLE_FROM_SCENE};
    Rgb x = v;
    for (int i = 0; i < 200; ++i) {
      for (size_t r = 0; r < 3; ++r) {
        double off = v[r];
        for (size_t c = 0; c < 3; ++c) off -= kM[3 * r + c] * x[c];
        x[r] += off / kM[4 * r];
      }
    }
    return x;
  };
  int points = 0;
  for (uint32_t b = 0; b < kSize; ++b) {
    for (uint32_t g = 0; g < kSize; ++g) {
      for (uint32_t r = 0; r < kSize; ++r) {
        const Rgb light =
            inverse({table_axis_value(r, kSize, kTableEnd), table_axis_value(g, kSize, kTableEnd),
                     table_axis_value(b, kSize, kTableEnd)});
        if (std::min({light[0], light[1], light[2]}) < 0.0) continue;
        ++points;
        const Rgb truth = aces(light);
        const Rgb held = reference::look_up(*table, light);
        for (size_t k = 0; k < 3; ++k)
          worst = std::max(worst, std::abs(srgb(held[k]) - srgb(truth[k])) * 255.0);
      }
    }
  }
  std::printf("%d lattice points: at most %.5f codes off\n", points, worst);
  EXPECT_GT(points, 100);
  EXPECT_LE(worst, 0.02);
}

struct Error {
  double max = 0.0;
  double p999 = 0.0;
  double mean = 0.0;
};

Error error_of(const ColorTable& table, const std::vector<Rgb>& colors) {
  std::vector<double> codes;
  for (const Rgb& c : colors) {
    const Rgb truth = aces(c);
    const Rgb got = reference::look_up(table, c);
    for (size_t k = 0; k < 3; ++k) codes.push_back(std::abs(srgb(got[k]) - srgb(truth[k])) * 255.0);
  }
  std::sort(codes.begin(), codes.end());
  double sum = 0.0;
  for (double c : codes) sum += c;
  return {codes.back(), codes[static_cast<size_t>(static_cast<double>(codes.size() - 1) * 0.999)],
          sum / static_cast<double>(codes.size())};
}

// The table of docs/pipeline.md section 5.
TEST(ColorTable, IsWithinItsPublishedErrorOfOpenColorIO) {
  std::mt19937 random(1);
  const auto uniform = [&random](double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
  };
  std::vector<Rgb> greys, likely, any, saturated;
  for (int i = 0; i < 4000; ++i) {
    const double v = std::exp2(-12.0 + 20.0 * i / 4000.0);
    greys.push_back({v, v, v});
  }
  for (int i = 0; i < 40000; ++i) {
    const double base = uniform(-9, 4);
    likely.emplace_back();
    for (double& v : likely.back()) v = std::exp2(base + uniform(-1, 1));
    any.emplace_back();
    for (double& v : any.back()) v = std::exp2(uniform(-12, 8));
    const double light = std::exp2(uniform(-10, 6));
    saturated.emplace_back();
    for (double& v : saturated.back()) v = uniform(0, 1) < 0.4 ? 0.0 : light * uniform(0, 1);
  }
  struct Bound {
    uint32_t size;
    Error greys, likely, any, saturated;
  };
  // The measured errors plus a small margin.
  const Bound bounds[] = {
      {17, {1.40, 1.40, 0.22}, {3.8, 2.7, 0.38}, {18.0, 5.0, 0.30}, {17.5, 4.5, 0.27}},
      {33, {0.42, 0.42, 0.075}, {1.8, 1.0, 0.13}, {7.2, 1.5, 0.105}, {4.8, 1.35, 0.09}},
      {49, {0.21, 0.21, 0.045}, {0.92, 0.60, 0.07}, {2.2, 0.80, 0.06}, {1.8, 0.80, 0.052}},
      {65, {0.15, 0.15, 0.03}, {0.76, 0.45, 0.047}, {1.45, 0.72, 0.046}, {1.3, 0.60, 0.035}},
  };
  std::printf("codes against OpenColorIO: max, p99.9, mean\n%-5s%-24s%-24s%-24s%-24s\n", "size", "greys",
              "within an octave", "any colour to 2^8", "saturated");
  for (const Bound& bound : bounds) {
    ASSERT_OK_AND_ASSIGN(const auto table, aces_1_table(bound.size));
    std::printf("%-5u", bound.size);
    const std::pair<const std::vector<Rgb>*, Error> sets[] = {
        {&greys, bound.greys}, {&likely, bound.likely}, {&any, bound.any}, {&saturated, bound.saturated}};
    for (const auto& [colors, allowed] : sets) {
      const Error error = error_of(*table, *colors);
      std::printf("%7.3f %7.3f %7.4f ", error.max, error.p999, error.mean);
      EXPECT_LE(error.max, allowed.max) << bound.size;
      EXPECT_LE(error.p999, allowed.p999) << bound.size;
      EXPECT_LE(error.mean, allowed.mean) << bound.size;
    }
    std::printf("\n");
  }
}

// The ACES 2.0 output transform against OpenColorIO's published test values and against its processors.

using Color64 = std::array<double, 3>;

struct Output {
  const char* name;  // in OpenColorIO's "ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - NAME_2.0"
  double peak_nits;
  v1::Primaries limiting;
  double scale = 1;  // of cinema's outputs
};

constexpr Output kOutputs[] = {{"SDR-100nit-REC709", 100, v1::PRIMARIES_REC709},
                               {"SDR-100nit-P3-D65", 100, v1::PRIMARIES_P3_D65},
                               {"HDR-108nit-P3-D65", 225, v1::PRIMARIES_P3_D65, 0.48},
                               {"HDR-300nit-P3-D65", 625, v1::PRIMARIES_P3_D65, 0.48},
                               {"HDR-500nit-P3-D65", 500, v1::PRIMARIES_P3_D65},
                               {"HDR-1000nit-P3-D65", 1000, v1::PRIMARIES_P3_D65},
                               {"HDR-2000nit-P3-D65", 2000, v1::PRIMARIES_P3_D65},
                               {"HDR-4000nit-P3-D65", 4000, v1::PRIMARIES_P3_D65},
                               {"HDR-500nit-REC2020", 500, v1::PRIMARIES_REC2020},
                               {"HDR-1000nit-REC2020", 1000, v1::PRIMARIES_REC2020},
                               {"HDR-2000nit-REC2020", 2000, v1::PRIMARIES_REC2020},
                               {"HDR-4000nit-REC2020", 4000, v1::PRIMARIES_REC2020}};

Color64 xyz_of(const Aces2& transform, const Color64& aces, v1::Primaries limiting) {
  const Color64 rgb = transform.display(aces);
  const std::array<double, 9> m = matrix_to_xyz(chromaticities(limiting));
  Color64 xyz{};
  for (size_t i = 0; i < 9; ++i) xyz[i / 3] += m[i] * rgb[i % 3];
  return xyz;
}

// OpenColorIO's tests/cpu/transforms/builtins/ACES2_tests.cpp and BuiltinTransform_tests.cpp.
TEST(Aces2, HasThePublishedValues) {
  struct Published {
    double peak_nits;
    v1::Primaries limiting;
    Color64 xyz;
  };
  for (const Published& p : {Published{100, v1::PRIMARIES_REC709, {0.26260215, 0.25207460, 0.20617345}},
                             Published{500, v1::PRIMARIES_REC2020, {0.41039288, 0.38813818, 0.30191860}},
                             Published{1000, v1::PRIMARIES_REC2020, {0.46536580, 0.43852842, 0.33688098}},
                             Published{2000, v1::PRIMARIES_REC2020, {0.51225960, 0.48264492, 0.37060046}},
                             Published{4000, v1::PRIMARIES_REC2020, {0.55653548, 0.51967967, 0.38678783}}}) {
    const Color64 xyz = xyz_of(Aces2(p.peak_nits, chromaticities(p.limiting)), {0.5, 0.4, 0.3}, p.limiting);
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(xyz[k], p.xyz[k], 1e-5) << p.peak_nits << " " << k;
  }
}

TEST(Aces2, TellsLimitingGamutsApart) {
  const Color64 far = {0.562714786, 3.438684474, 0.016100841};
  const auto xyz = [&](v1::Primaries limiting) {
    return xyz_of(Aces2(1000, chromaticities(limiting)), far, limiting);
  };
  const Color64 p3 = xyz(v1::PRIMARIES_P3_D65), rec2020 = xyz(v1::PRIMARIES_REC2020);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(p3[k], (Color64{1.033632, 2.573298, 0.448537})[k], 1e-6);
    EXPECT_NEAR(rec2020[k], (Color64{0.597625, 2.754290, 0.113852})[k], 1e-6);
  }
}

TEST(Aces2, GreyIsAsBrightAsPublished) {
  for (const auto& [peak, nits] :
       {std::pair(100.0, 9.999933), std::pair(500.0, 13.192876), std::pair(1000.0, 14.511552),
        std::pair(2000.0, 15.746733), std::pair(4000.0, 16.824208)}) {
    const Aces2 transform(peak, chromaticities(v1::PRIMARIES_REC709));
    EXPECT_NEAR(xyz_of(transform, {0.18, 0.18, 0.18}, v1::PRIMARIES_REC709)[1] * 100, nits, 1e-5);
  }
}

TEST(Aces2, IsWithinTheDisplayForAnyLight) {
  const Aces2 transform(100, chromaticities(v1::PRIMARIES_REC709));
  for (const Color64& c :
       {Color64{0, 0, 0}, Color64{1e12, 1e12, 1e12}, Color64{1e12, 0, 0}, Color64{0, -1e12, 1},
        Color64{1e-9, 0, 0}, Color64{-1, -1, -1}, Color64{0, 0, 65504}}) {
    for (const double v : transform.display(c)) EXPECT_TRUE(v >= 0 && v <= 1) << v;
  }
}

TEST(Aces2, AgreesWithOpenColorIOForEveryOutput) {
  if (data_folder().empty()) GTEST_SKIP() << "no test data; set CANDELA_DATA";
  const auto points = nlohmann::json::parse(read_file(data_folder() + "/aces2/points.json"))["aces2065_1"];
  const auto expected = nlohmann::json::parse(read_file(data_folder() + "/aces2/expected.json"))["outputs"];
  for (const Output& output : kOutputs) {
    const std::string name = std::string("ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - ") + output.name + "_2.0";
    const auto found =
        std::ranges::find_if(expected, [&](const auto& one) { return one["builtin"] == name; });
    ASSERT_TRUE(found != expected.end()) << name;
    const Aces2 transform(output.peak_nits, chromaticities(output.limiting));
    double worst = 0, sum = 0;
    for (size_t i = 0; i < points.size(); ++i) {
      const Color64 xyz = xyz_of(transform, points[i].template get<Color64>(), output.limiting);
      for (size_t k = 0; k < 3; ++k) {
        const double error = std::abs(output.scale * xyz[k] - (*found)["xyz"][i][k].template get<double>()) /
                             (output.scale * output.peak_nits / 100);
        worst = std::max(worst, error);
        sum += error;
      }
    }
    std::printf("%s: at most %.1e of the peak off, %.1e on average\n", output.name, worst,
                sum / (3 * static_cast<double>(points.size())));
    EXPECT_LE(worst, 1e-4) << output.name;
  }
}

// The table of aces-1 for light outside of Rec.709, against OpenColorIO.

struct WideTableError {
  double max = 0.0;
  double p999 = 0.0;
  double mean = 0.0;
};

// Of a table, for colours in Rec.709.
WideTableError error_of(const ColorTable& table, const std::vector<testing::Color>& colors) {
  std::vector<double> codes;
  double sum = 0.0;
  for (const testing::Color& c : colors) {
    testing::Color truth = c;
    EXPECT_OK(aces_1(truth));
    const reference::Rgb light = reference::look_up(table, {c[0], c[1], c[2]});
    for (size_t k = 0; k < 3; ++k) {
      const double value = reference::transfer(shader::TRANSFER_SRGB, std::clamp(light[k], 0.0, 1.0));
      codes.push_back(testing::codes_off(value, truth[k]));
      sum += codes.back();
    }
  }
  std::sort(codes.begin(), codes.end());
  const auto count = static_cast<double>(codes.size());
  return {codes.back(), codes[static_cast<size_t>((count - 1) * 0.999)], sum / count};
}

std::vector<testing::Color> brighter(std::vector<testing::Color> colors) {
  for (testing::Color& c : colors) {
    for (float& v : c) v *= 256.0f;
  }
  return colors;
}

// The second table of docs/pipeline.md section 5.
TEST(WideTable, IsWithinItsPublishedErrorOfOpenColorIO) {
  std::map<std::string, std::vector<testing::Color>> sets;
  for (const v1::Primaries primaries :
       {v1::PRIMARIES_ACES_AP1, v1::PRIMARIES_ACES_AP0, v1::PRIMARIES_P3_D65, v1::PRIMARIES_REC2020}) {
    sets[v1::word_of(primaries)] = testing::saturated_inside_ap1(primaries, 40000).rec709;
  }
  sets["AP1 x 256"] = brighter(sets["aces-ap1"]);
  struct Bound {
    uint32_t size;
    WideTableError error;
  };
  std::printf("%-5s%-12s %7s %7s %7s  codes against OpenColorIO\n", "size", "colours", "max", "p99.9",
              "mean");
  for (const Bound& bound : {Bound{49, {12.0, 4.0, 0.1}}, Bound{97, {3.0, 1.2, 0.05}}}) {
    ASSERT_OK_AND_ASSIGN(const auto table, aces_1_wide_table(bound.size));
    for (const auto& [name, colors] : sets) {
      const WideTableError error = error_of(*table, colors);
      std::printf("%-5u%-12s %7.3f %7.3f %7.4f\n", bound.size, name.c_str(), error.max, error.p999,
                  error.mean);
      const bool bright = name == "AP1 x 256";  // mostly beyond the end of the axes
      EXPECT_LE(error.max, bright ? 6.5 : bound.error.max) << name;
      EXPECT_LE(error.p999, bright ? 5.0 : bound.error.p999) << name;
      EXPECT_LE(error.mean, bound.error.mean) << name;
    }
  }
  // The table for frames without negative components would not do.
  EXPECT_GT(error_of(**aces_1_table(65), sets["aces-ap1"]).max, 20.0);
}

TEST(WideTable, ColoursOfRec709AreNoWorseThanInTheirOwnTable) {
  std::vector<testing::Color> colors;
  uint32_t state = 1;
  for (int i = 0; i < 20000; ++i) {
    testing::Color c;
    for (float& v : c)
      v = std::exp2(20.0f * static_cast<float>((state = state * 1664525u + 1013904223u) >> 8) / 16777216.0f -
                    12.0f);
    colors.push_back(c);
  }
  const WideTableError own = error_of(**aces_1_table(65), colors);
  const WideTableError wide = error_of(**aces_1_wide_table(97), colors);
  EXPECT_LE(wide.max, 1.8);
  EXPECT_LE(wide.p999, own.p999);
  EXPECT_LE(wide.mean, own.mean);
}

// The functions of server/render/color/portable_math.h against those of long double, and a few of their bits.

// Half a unit in the last place, and what long double itself may be wrong by.
void expect_rounded(double ours, long double exact, double x) {
  const double unit = std::nextafter(std::fabs(ours), INFINITY) - std::fabs(ours);
  EXPECT_LE(std::fabs(static_cast<double>(ours - exact)), 0.501 * unit) << x;
}

TEST(PortableMath, IsRoundedToTheNearest) {
  std::mt19937_64 random(1);
  const auto between = [&](double low, double high) {
    return low + (high - low) * std::ldexp(static_cast<double>(random() >> 11), -53);
  };
  for (int i = 0; i < 20000; ++i) {
    double x = between(-80, 80);
    expect_rounded(portable_exp2(x), std::exp2(static_cast<long double>(x)), x);
    expect_rounded(portable_exp(x), std::exp(static_cast<long double>(x)), x);
    x = between(-30, 30) * (i % 2 == 0 ? 1 : 0.01);
    expect_rounded(portable_expm1(x), std::expm1(static_cast<long double>(x)), x);
    x = std::exp(between(-60, 60));
    expect_rounded(portable_log2(x), std::log2(static_cast<long double>(x)), x);
  }
}

TEST(PortableMath, HasTheSameBitsEverywhere) {
  EXPECT_EQ(portable_exp2(0.3), 0x1.3b2c47bff8329p+0);
  EXPECT_EQ(portable_exp(-0.7), 0x1.fc80db9dd5542p-2);
  EXPECT_EQ(portable_expm1(-0.1), -0x1.85c933156a62cp-4);
  EXPECT_EQ(portable_log2(0.18), -0x1.3ca9c6f53897ap+1);
}

TEST(PortableMath, PowersOfTwoAreExactAndTheEndsAreThere) {
  for (int i = -1000; i <= 1000; ++i) {
    EXPECT_EQ(portable_exp2(i), std::ldexp(1.0, i));
    EXPECT_EQ(portable_log2(std::ldexp(1.0, i)), i);
  }
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(portable_exp(0), 1);
  EXPECT_EQ(portable_expm1(0), 0);
  EXPECT_EQ(portable_exp(-1e12), 0);
  EXPECT_EQ(portable_expm1(-1e12), -1);
  EXPECT_EQ(portable_exp2(-kInfinity), 0);
  for (double (*grows)(double) : {portable_exp2, portable_exp, portable_expm1, portable_log2}) {
    EXPECT_EQ(grows(kInfinity), kInfinity);
    EXPECT_TRUE(std::isnan(grows(NAN)));
  }
}

}  // namespace

namespace testing {
namespace {

// The settings of HDR displays: what is left unset, and what does not go together.

using Change = std::function<void(v1::Settings&)>;

absl::StatusOr<Settings> settings_with(const std::vector<Change>& changes) {
  v1::Settings message;
  for (const Change& change : changes) change(message);
  return Settings::from(message);
}

const Change kPq = [](v1::Settings& s) { s.set_transfer(v1::TRANSFER_PQ); };
const Change kHlg = [](v1::Settings& s) { s.set_transfer(v1::TRANSFER_HLG); };
const Change kAces2 = [](v1::Settings& s) { s.set_curve(v1::TONE_CURVE_ACES_2); };
const Change kP3 = [](v1::Settings& s) { s.set_display_primaries(v1::PRIMARIES_P3_D65); };
Change peak(double nits) {
  return [=](v1::Settings& s) { s.set_peak_nits(nits); };
}
Change source_peak(double nits) {
  return [=](v1::Settings& s) { s.set_source_peak_nits(nits); };
}
Change limit(v1::Primaries primaries) {
  return [=](v1::Settings& s) { s.set_limit_primaries(primaries); };
}

TEST(HdrDisplay, HasThePublishedSignals) {
  for (const auto& [nits, signal] :
       {std::pair(0.0, 7.30955903e-7), std::pair(1.0, .149945732), std::pair(100.0, .508078421517),
        std::pair(203.0, .580688881042), std::pair(1000.0, .751827096247), std::pair(4000.0, .902572393311),
        std::pair(10000.0, 1.0)}) {
    EXPECT_NEAR(pq_signal(nits / 10000), signal, 1e-9) << nits;
  }
  for (const auto& [nits, gamma] : {std::pair(1000.0, 1.2), std::pair(2000.0, 1.326432598)}) {
    EXPECT_NEAR(1 / (1 + hlg_exponent(nits)), gamma, 1e-9) << nits;
  }
}

TEST(HdrDisplay, TakesItsOwnDefaults) {
  for (const Change& transfer : {kPq, kHlg}) {
    ASSERT_OK_AND_ASSIGN(const Settings settings, settings_with({transfer}));
    EXPECT_EQ(settings->curve(), v1::TONE_CURVE_BT2390);
    EXPECT_EQ(settings->output_format(), v1::OUTPUT_FORMAT_RGBA16);
    EXPECT_EQ(settings->display_primaries(), v1::PRIMARIES_REC2020);
    EXPECT_EQ(settings->peak_nits(), 1000);
    EXPECT_EQ(settings->source_peak_nits(), 10000);
    EXPECT_EQ(settings->limit_primaries(), v1::PRIMARIES_UNSPECIFIED);
  }
  ASSERT_OK_AND_ASSIGN(const Settings aces, settings_with({kPq, kAces2}));
  EXPECT_EQ(limit_of(*aces), v1::PRIMARIES_P3_D65);
  EXPECT_FALSE(aces->has_source_peak_nits());
  ASSERT_OK_AND_ASSIGN(const Settings sdr, settings_with({}));
  EXPECT_EQ(sdr->curve(), v1::TONE_CURVE_ACES_HILL);
  EXPECT_FALSE(sdr->has_peak_nits());
}

TEST(HdrDisplay, WhatGoesTogetherIsTaken) {
  const Change linear = [](v1::Settings& s) { s.set_curve(v1::TONE_CURVE_LINEAR); };
  for (const std::vector<Change>& changes : {std::vector<Change>{kPq, kP3, peak(100)},
                                             {kPq, peak(10000), source_peak(10000)},
                                             {kHlg, peak(400)},
                                             {kHlg, peak(2000), linear},
                                             {kPq, kAces2, peak(500)},
                                             {kHlg, kAces2, peak(2000)},
                                             {kPq, kAces2, peak(4000), limit(v1::PRIMARIES_REC2020)},
                                             {kPq, kP3, kAces2, limit(v1::PRIMARIES_P3_D65)}}) {
    EXPECT_OK(settings_with(changes));
  }
}

TEST(HdrDisplay, WhatDoesNotGoTogetherIsRefusedByName) {
  const auto curve = [](v1::ToneCurve c) { return Change([=](v1::Settings& s) { s.set_curve(c); }); };
  const auto output = [](v1::OutputFormat f) {
    return Change([=](v1::Settings& s) { s.set_output_format(f); });
  };
  struct Case {
    std::vector<Change> changes;
    std::string words;
  };
  for (const Case& one : std::vector<Case>{
           {{peak(1000)}, "peak_nits is 1000, which is for HDR displays"},
           {{source_peak(1000)},
            "source_peak_nits is 1000 and curve is aces-hill; only bt2390 and shoulder have a source's peak"},
           {{curve(v1::TONE_CURVE_SHOULDER), source_peak(202)},
            "source_peak_nits is 202 and the display's peak 203 nit"},
           {{kPq, curve(v1::TONE_CURVE_SHOULDER)}, "curve is shoulder and transfer is pq"},
           {{kP3}, "display_primaries is p3-d65, which is for HDR displays"},
           {{limit(v1::PRIMARIES_P3_D65)}, "limit_primaries is p3-d65, which is for HDR displays"},
           {{kPq, curve(v1::TONE_CURVE_ACES_HILL)}, "curve is aces-hill and transfer is pq"},
           {{kPq, output(v1::OUTPUT_FORMAT_RGBA8)},
            "output_format is rgba8 and transfer is pq, which shows bands"},
           {{kHlg, output(v1::OUTPUT_FORMAT_RGBA16F)}, "output_format is rgba16f, which has no transfer"},
           {{kPq, peak(99)}, "peak_nits is 99"},
           {{kPq, peak(10001)}, "peak_nits is 10001"},
           {{kHlg, peak(399)}, "peak_nits is 399; with hlg it must be between 400 and 2000"},
           {{kHlg, peak(2001)}, "peak_nits is 2001; with hlg it must be between 400 and 2000"},
           {{kPq, kAces2, peak(1500)}, "curve is aces-2, which is published for 500, 1000, 2000 and 4000"},
           {{kPq, kAces2, source_peak(4000)}, "only bt2390 and shoulder have a source's peak"},
           {{kPq, peak(1000), source_peak(999)}, "source_peak_nits is 999 and the display's peak 1000 nit"},
           {{kPq, limit(v1::PRIMARIES_P3_D65)}, "curve is bt2390; only aces-2 has a limit"},
           {{kPq, kAces2, kP3, limit(v1::PRIMARIES_REC2020)},
            "limit_primaries is rec2020 and display_primaries is p3-d65"},
           {{kPq, kAces2, limit(v1::PRIMARIES_REC709)}, "limit_primaries is rec709"},
           {{kPq, [](v1::Settings& s) { s.set_display_primaries(v1::PRIMARIES_REC709); }},
            "HDR displays have rec2020 or p3-d65"}}) {
    const absl::Status status = settings_with(one.changes).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << one.words;
    EXPECT_NE(status.message().find(one.words), absl::string_view::npos) << status.message();
  }
}

}  // namespace
}  // namespace testing
}  // namespace candela
