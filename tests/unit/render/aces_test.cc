// The curve aces-1 against published values, and its table against OpenColorIO.
#include "server/render/color/aces.h"

#include <OpenColorIO/OpenColorIO.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <vector>

#include "server/render/color/primaries.h"
#include "server/render/settings/settings.h"
#include "shaders/reference.h"
#include "tests/support/files.h"
#include "tests/support/status.h"

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

}  // namespace
}  // namespace candela
