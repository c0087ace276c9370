// The ACES 2.0 output transform against OpenColorIO's published test values and against its processors.
#include "server/render/color/aces2.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/files.h"

namespace candela {
namespace {

using Color = std::array<double, 3>;

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

Color xyz_of(const Aces2& transform, const Color& aces, v1::Primaries limiting) {
  const Color rgb = transform.display(aces);
  const std::array<double, 9> m = matrix_to_xyz(chromaticities(limiting));
  Color xyz{};
  for (size_t i = 0; i < 9; ++i) xyz[i / 3] += m[i] * rgb[i % 3];
  return xyz;
}

// OpenColorIO's tests/cpu/transforms/builtins/ACES2_tests.cpp and BuiltinTransform_tests.cpp.
TEST(Aces2, HasThePublishedValues) {
  struct Published {
    double peak_nits;
    v1::Primaries limiting;
    Color xyz;
  };
  for (const Published& p : {Published{100, v1::PRIMARIES_REC709, {0.26260215, 0.25207460, 0.20617345}},
                             Published{500, v1::PRIMARIES_REC2020, {0.41039288, 0.38813818, 0.30191860}},
                             Published{1000, v1::PRIMARIES_REC2020, {0.46536580, 0.43852842, 0.33688098}},
                             Published{2000, v1::PRIMARIES_REC2020, {0.51225960, 0.48264492, 0.37060046}},
                             Published{4000, v1::PRIMARIES_REC2020, {0.55653548, 0.51967967, 0.38678783}}}) {
    const Color xyz = xyz_of(Aces2(p.peak_nits, chromaticities(p.limiting)), {0.5, 0.4, 0.3}, p.limiting);
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(xyz[k], p.xyz[k], 1e-5) << p.peak_nits << " " << k;
  }
}

TEST(Aces2, TellsLimitingGamutsApart) {
  const Color far = {0.562714786, 3.438684474, 0.016100841};
  const auto xyz = [&](v1::Primaries limiting) {
    return xyz_of(Aces2(1000, chromaticities(limiting)), far, limiting);
  };
  const Color p3 = xyz(v1::PRIMARIES_P3_D65), rec2020 = xyz(v1::PRIMARIES_REC2020);
  for (size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(p3[k], (Color{1.033632, 2.573298, 0.448537})[k], 1e-6);
    EXPECT_NEAR(rec2020[k], (Color{0.597625, 2.754290, 0.113852})[k], 1e-6);
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
  for (const Color& c : {Color{0, 0, 0}, Color{1e12, 1e12, 1e12}, Color{1e12, 0, 0}, Color{0, -1e12, 1},
                         Color{1e-9, 0, 0}, Color{-1, -1, -1}, Color{0, 0, 65504}}) {
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
      const Color xyz = xyz_of(transform, points[i].template get<Color>(), output.limiting);
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

}  // namespace
}  // namespace candela
