// The table of aces-1 for light outside of Rec.709, against OpenColorIO.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "proto/candela/v1/settings.h"
#include "server/render/color/aces.h"
#include "shaders/reference.h"
#include "tests/support/status.h"
#include "tests/support/wide_gamut.h"

namespace candela {
namespace {

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

}  // namespace
}  // namespace candela
