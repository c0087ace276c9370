// White balance: the Planckian locus, the tint, and what it does to the matrix. No device.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "server/render/color/primaries.h"
#include "server/render/settings/settings.h"

namespace candela {
namespace {

struct Uv {
  double u;
  double v;
};

Uv uv_of(const White& white) {
  const double scale = -2 * white.x + 12 * white.y + 3;
  return {4 * white.x / scale, 6 * white.y / scale};
}

using Rgb = std::array<double, 3>;

Rgb times(const std::array<float, 9>& m, const Rgb& c) {
  return {m[0] * c[0] + m[1] * c[1] + m[2] * c[2], m[3] * c[0] + m[4] * c[1] + m[5] * c[2],
          m[6] * c[0] + m[7] * c[1] + m[8] * c[2]};
}

// Linear Rec.709 of a chromaticity at luminance 1, by the matrix of IEC 61966-2-1.
Rgb rec709_of(const White& white) {
  const double x = white.x / white.y;
  const double z = (1 - white.x - white.y) / white.y;
  return {3.2406 * x - 1.5372 - 0.4986 * z, -0.9689 * x + 1.8758 + 0.0415 * z,
          0.0557 * x - 0.2040 + 1.0570 * z};
}

Settings balanced(double kelvin, double tint) {
  v1::Settings settings;
  settings.set_white_balance(kelvin);
  settings.set_tint(tint);
  return Settings::from(settings).value();
}

// G. Wyszecki and W. Stiles, "Color Science", 2nd edition, table 1(5.3.1)'s Planckian radiators; illuminant A
// is CIE 15's.
TEST(WhiteBalance, TheLocusIsPlancks) {
  struct Published {
    double kelvin, x, y;
  };
  for (const auto& [kelvin, x, y] : {Published{2000, 0.5267, 0.4133},
                                     {2856, 0.4476, 0.4074},
                                     {3000, 0.4369, 0.4041},
                                     {4000, 0.3805, 0.3768},
                                     {5000, 0.3451, 0.3516},
                                     {6500, 0.3135, 0.3237},
                                     {10000, 0.2807, 0.2884}}) {
    const White white = white_of(kelvin, 0);
    EXPECT_NEAR(white.x, x, 1e-4) << kelvin;
    EXPECT_NEAR(white.y, y, 1e-4) << kelvin;
  }
}

// Light of 0.18 in linear Rec.709, balanced.
Rgb grey(double kelvin, double tint) {
  const std::optional<std::array<float, 9>> matrix = balanced(kelvin, tint).to_scene();
  return matrix ? times(*matrix, {0.18, 0.18, 0.18}) : Rgb{0.18, 0.18, 0.18};
}

// From 1 K to the next, a white moves by 0.1 % more or less than it just did, and never back.
TEST(WhiteBalance, AStepOfOneKelvinIsAsLongAsTheOneBefore) {
  for (double tint : {-1.0, 0.0, 1.0}) {
    White white = white_of(2001, tint);
    White before = white_of(2000, tint);
    for (int kelvin = 2002; kelvin <= 25000; ++kelvin) {
      const White next = white_of(kelvin, tint);
      const double x = white.x - before.x, y = white.y - before.y;
      const double next_x = next.x - white.x, next_y = next.y - white.y;
      ASSERT_NEAR(std::hypot(next_x, next_y) / std::hypot(x, y), 1.0, 1e-3) << kelvin << " " << tint;
      ASSERT_GT(x * next_x + y * next_y, 0.999 * std::hypot(x, y) * std::hypot(next_x, next_y))
          << kelvin << " " << tint;
      before = white;
      white = next;
    }
  }
}

// At 2222 and 4000 K the cubics of Kang et al. have joints. With tint 1 at 4000 K the blue of a grey is 44
// times itself, and moves by 1 % from one kelvin to the next.
TEST(WhiteBalance, AGreyMovesSmoothlyOverItsTemperature) {
  for (double kelvin : {2222.0, 4000.0, 9000.0}) {
    for (double tint : {-1.0, 0.0, 1.0}) {
      const Rgb below = grey(kelvin - 1, tint), at = grey(kelvin, tint), above = grey(kelvin + 1, tint);
      for (size_t k = 0; k < 3; ++k) {
        const double rounding = 2e-7 * std::max(1.0, std::abs(at[k]));  // of the matrix
        EXPECT_NEAR(at[k], (below[k] + above[k]) / 2, 0.02 * std::abs(above[k] - below[k]) + rounding)
            << kelvin << " " << tint << " " << k;
      }
    }
  }
}

TEST(WhiteBalance, ATintIsADistanceFromTheLocusTowardsGreen) {
  for (double kelvin : {2000.0, 2222.0, 3200.0, 4000.0, 6504.0, 12000.0, 25000.0}) {
    const Uv on = uv_of(white_of(kelvin, 0));
    const Uv above = uv_of(white_of(kelvin, 1));
    const Uv below = uv_of(white_of(kelvin, -0.5));
    EXPECT_NEAR(std::hypot(above.u - on.u, above.v - on.v), 0.05, 1e-9) << kelvin;
    EXPECT_NEAR(std::hypot(below.u - on.u, below.v - on.v), 0.025, 1e-9) << kelvin;
    EXPECT_GT(above.v, on.v) << kelvin;
    EXPECT_LT(below.v, on.v) << kelvin;
  }
}

TEST(WhiteBalance, DaylightIsItselfBalanced) {
  const White d65 = white_of(6504, 0.064);
  EXPECT_NEAR(d65.x, 0.3127, 1e-4);
  EXPECT_NEAR(d65.y, 0.3290, 1e-4);
}

TEST(WhiteBalance, TheScenesWhiteBecomesNeutral) {
  for (double kelvin : {2500.0, 3200.0, 5000.0, 9000.0, 20000.0}) {
    for (double tint : {-0.3, 0.0, 0.3}) {
      const Settings settings = balanced(kelvin, tint);
      ASSERT_TRUE(settings.to_scene());
      const Rgb neutral = times(*settings.to_scene(), rec709_of(white_of(kelvin, tint)));
      EXPECT_NEAR(neutral[0] / neutral[1], 1.0, 2e-3) << kelvin << " " << tint;
      EXPECT_NEAR(neutral[2] / neutral[1], 1.0, 2e-3) << kelvin << " " << tint;
    }
  }
}

TEST(WhiteBalance, FollowsThePrimariesOfTheFrame) {
  v1::Settings settings;
  settings.set_input_primaries(v1::PRIMARIES_ACES_AP1);
  const auto plain = *Settings::from(settings)->to_scene();
  settings.set_white_balance(3200);
  const auto both = *Settings::from(settings)->to_scene();
  const auto balance = *balanced(3200, 0).to_scene();
  for (const Rgb& c : {Rgb{1, 0, 0}, Rgb{0, 1, 0}, Rgb{0, 0, 1}}) {
    const Rgb in_two_steps = times(balance, times(plain, c));
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(times(both, c)[k], in_two_steps[k], 2e-6);
  }
}

TEST(WhiteBalance, AbsentItIsNoMatrixAndATintNeedsIt) {
  EXPECT_FALSE(Settings().to_scene());
  v1::Settings settings;
  settings.set_tint(0.2);
  const absl::Status status = Settings::from(settings).status();
  EXPECT_EQ(status.message(), "tint is 0.2 and there is no white_balance; give both, or leave the tint out");
  settings.set_white_balance(1999);
  EXPECT_EQ(Settings::from(settings).status().message(),
            "white_balance is 1999; it must be between 2000 and 25000");
}

}  // namespace
}  // namespace candela
