// The host's decisions for a frame: where light reaches, filters of other sizes, metering, exposure, the
// plan.
#include "server/render/plan/plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "server/render/color/primaries.h"
#include "server/render/plan/exposure.h"
#include "server/render/plan/lit_area.h"
#include "server/render/plan/resize_plan.h"
#include "server/render/settings/settings.h"
#include "shaders/reference.h"
#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela {
namespace {

// The texels that are not 0.
struct Grid {
  LevelSize size;
  std::vector<bool> lit;

  explicit Grid(LevelSize of) : size(of), lit(size_t{of.width} * of.height) {}
  // Clamped to the edge, as the passes read.
  bool at(int64_t x, int64_t y) const {
    const auto clamped = [](int64_t v, uint32_t n) {
      return static_cast<size_t>(std::clamp<int64_t>(v, 0, n - 1));
    };
    return lit[clamped(y, size.height) * size.width + clamped(x, size.width)];
  }
  bool any(int64_t x0, int64_t y0, int64_t x1, int64_t y1) const {
    for (int64_t y = y0; y <= y1; ++y) {
      for (int64_t x = x0; x <= x1; ++x) {
        if (at(x, y)) return true;
      }
    }
    return false;
  }
  void set(uint32_t x, uint32_t y) { lit[size_t{y} * size.width + x] = true; }
};

Grid grid_of(const Area& area, LevelSize size) {
  Grid grid(size);
  for (const Box& box : area) {
    for (uint32_t y = box.y0; y < box.y1; ++y) {
      for (uint32_t x = box.x0; x < box.x1; ++x) grid.set(x, y);
    }
  }
  return grid;
}

// `reads(x, y)` says whether a texel of the new level reads a lit one.
template <typename Reads>
Grid next(LevelSize size, const Reads& reads) {
  Grid grid(size);
  for (uint32_t y = 0; y < size.height; ++y) {
    for (uint32_t x = 0; x < size.width; ++x) {
      if (reads(int64_t{x}, int64_t{y})) grid.set(x, y);
    }
  }
  return grid;
}

// Whether all of `lit` is in `area`.
void expect_holds(const Area& area, const Grid& lit, const std::string& what) {
  const Grid held = grid_of(area, lit.size);
  for (size_t i = 0; i < lit.lit.size(); ++i) {
    ASSERT_TRUE(!lit.lit[i] || held.lit[i])
        << what << ": texel " << i % lit.size.width << ", " << i / lit.size.width;
  }
}

size_t count(const std::vector<bool>& cells) {
  return static_cast<size_t>(std::count(cells.begin(), cells.end(), true));
}

constexpr std::pair<uint32_t, uint32_t> kSizes[] = {{1, 1}, {63, 65}, {200, 130}, {257, 511}, {640, 360}};

TEST(LitArea, HoldsEveryTexelThatAPassMakesOfLight) {
  std::mt19937 random(7);
  for (const auto& [width, height] : kSizes) {
    const uint32_t tiles_x = (width + 63) / 64, tiles_y = (height + 63) / 64;
    for (const uint32_t level_size : {2u, 4u}) {
      for (int round = 0; round < 4; ++round) {
        const std::string what = std::to_string(width) + "x" + std::to_string(height) + ", round " +
                                 std::to_string(round) + ", level size " + std::to_string(level_size);
        std::vector<float> light(size_t{tiles_x} * tiles_y, 0.5f);
        light[random() % light.size()] = 2.0f;
        if (round > 1) light[random() % light.size()] = 2.0f;
        Area area = lit_area(light, width, height, 1.0f);
        Grid frame(LevelSize{width, height});
        for (uint32_t y = 0; y < height; ++y) {
          for (uint32_t x = 0; x < width; ++x) {
            if (light[size_t{y / 64} * tiles_x + x / 64] > 1.0f) frame.set(x, y);
          }
        }
        ASSERT_EQ(grid_of(area, frame.size).lit, frame.lit) << what;

        const std::vector<LevelSize> sizes = bloom_level_sizes(width, height, 6, level_size);
        const int64_t n = level_size;
        Grid level = next(sizes[0], [&](int64_t x, int64_t y) {
          return frame.any(n * x, n * y, n * x + n - 1, n * y + n - 1);
        });
        area = in_level(area, level_size);
        expect_holds(area, level, what + ", level 0");
        // B_n also reads D_n, which lies within the reach of B_{n+1} and is checked with it.
        std::vector<Grid> down = {level};
        for (size_t i = 1; i < sizes.size(); ++i) {
          const Grid& from = down.back();
          down.push_back(next(sizes[i], [&](int64_t x, int64_t y) {
            return from.any(2 * x - 2, 2 * y - 2, 2 * x + 3, 2 * y + 3);
          }));
          area = after_bloom_down(area, sizes[i]);
          expect_holds(area, down.back(), what + ", down to " + std::to_string(i));
        }
        level = down.back();
        for (size_t i = sizes.size() - 1; i-- > 0;) {
          // Even texels read from x / 2 - 2 to x / 2 + 1, odd ones one texel further.
          const auto first = [](int64_t x) { return x / 2 - 2 + x % 2; };
          level = next(sizes[i], [&](int64_t x, int64_t y) {
            return down[i].at(x, y) || level.any(first(x), first(y), first(x) + 3, first(y) + 3);
          });
          area = after_bloom_up(area, sizes[i]);
          expect_holds(area, level, what + ", up to " + std::to_string(i));
          // An even and an odd texel count as one, at each of five levels.
          if (i == 0) {
            EXPECT_LE(count(grid_of(area, level.size).lit), count(level.lit) * 2 + 64) << what;
          }
        }
        const Grid seen = next({width, height}, [&](int64_t x, int64_t y) {
          const int64_t at = (2 * x + 1 - n) >> 1;  // in frame texels, from the first level texel's centre
          const int64_t row = (2 * y + 1 - n) >> 1;
          const auto below = [n](int64_t v) { return v >= 0 ? v / n : -1; };
          return level.any(below(at), below(row), below(at) + 1, below(row) + 1);
        });
        expect_holds(in_frame(area, level_size, width, height), seen, what + ", in the frame");
      }
    }
  }
}

TEST(LitArea, IsSeenInTheFrameATexelOfTheLevelAround) {
  EXPECT_EQ(in_level({{33, 64, 65, 128}}, 4), (Area{{8, 16, 17, 32}}));
  EXPECT_EQ(in_frame({{10, 0, 14, 24}}, 2, 100, 49), (Area{{18, 0, 30, 49}}));
  EXPECT_EQ(in_frame({{10, 0, 14, 24}}, 4, 57, 200), (Area{{36, 0, 57, 100}}));
}

TEST(LitArea, OfTheGaussianGrowsBySixTexelsEachWay) {
  const Area lit = {{10, 20, 14, 24}};
  EXPECT_EQ(after_gaussian(lit, {100, 100}, 0, 6), (Area{{10, 14, 14, 30}}));
  EXPECT_EQ(after_gaussian(lit, {16, 22}, 6, 0), (Area{{4, 20, 16, 22}}));
}

TEST(LitArea, IsCoveredByWholeGroupsAndTheRestIsTheOthers) {
  std::mt19937 random(3);
  for (int round = 0; round < 200; ++round) {
    const LevelSize size = {100 + static_cast<uint32_t>(random() % 400),
                            50 + static_cast<uint32_t>(random() % 200)};
    Area area;
    for (int i = 0; i < round % 6; ++i) {
      const auto x = static_cast<uint32_t>(random() % size.width),
                 y = static_cast<uint32_t>(random() % size.height);
      area.push_back(
          {x, y, std::min<uint32_t>(size.width, x + random() % 90), std::min<uint32_t>(size.height, y + 9)});
    }
    const uint32_t groups_x = (size.width + 15) / 16, groups_y = (size.height + 7) / 8;
    const Cover work = cover(area, 16, 8, groups_x, groups_y);
    std::vector<int> times(size_t{groups_x} * groups_y);
    for (const std::vector<Box>* part : {&work.groups, &work.rest}) {
      for (const Box& box : *part) {
        for (uint32_t y = box.y0; y < box.y1; ++y) {
          for (uint32_t x = box.x0; x < box.x1; ++x) ++times.at(size_t{y} * groups_x + x);
        }
      }
    }
    EXPECT_EQ(times, std::vector<int>(times.size(), 1)) << "each group is in one box";
    const Grid held = grid_of(work.groups, {groups_x, groups_y});
    const Grid lit = grid_of(area, size);
    for (uint32_t y = 0; y < size.height; ++y) {
      for (uint32_t x = 0; x < size.width; ++x) ASSERT_TRUE(!lit.at(x, y) || held.at(x / 16, y / 8));
    }
  }
}

TEST(LitArea, ThatIsNearlyAllOrInManyPiecesIsTakenWhole) {
  const std::vector<Box> all = {{0, 0, 20, 20}};
  EXPECT_EQ(cover({{0, 0, 20, 16}}, 1, 1, 20, 20).groups, all);
  EXPECT_TRUE(cover({{0, 0, 20, 16}}, 1, 1, 20, 20).whole());
  EXPECT_FALSE(cover({{0, 0, 20, 15}}, 1, 1, 20, 20).whole());
  Area pieces;
  for (uint32_t i = 0; i < 40; ++i)
    pieces.push_back({2 * (i % 10), 2 * (i / 10), 2 * (i % 10) + 1, 2 * (i / 10) + 1});
  EXPECT_EQ(cover(pieces, 1, 1, 20, 20).groups, all);
  EXPECT_TRUE(cover({}, 1, 1, 20, 20).groups.empty());
  EXPECT_EQ(cover({}, 1, 1, 20, 20).rest, all);
}

// The filters of images of another size.

const std::vector<std::pair<uint32_t, uint32_t>> kAxes = {
    {1, 1},       {1, 7},      {7, 1},        {2, 3},        {3, 2},     {1920, 1000},   {1080, 563},
    {1000, 1920}, {3840, 480}, {3840, 481},   {16384, 3},    {3, 16384}, {16384, 16383}, {16383, 16384},
    {100, 99},    {99, 100},   {16384, 5000}, {5000, 16384}, {640, 320}, {641, 320}};

double sinc(double t) { return t == 0 ? 1 : std::sin(std::numbers::pi * t) / (std::numbers::pi * t); }

TEST(AxisFilter, IsAMeanForWholeFactorsOnly) {
  for (const auto& [from, to] : kAxes) {
    const AxisFilter filter = axis_filter(from, to);
    EXPECT_EQ(filter.mean, from % to == 0 ? from / to : 0) << from << " to " << to;
    EXPECT_EQ(filter.weights.empty(), from % to == 0);
  }
  EXPECT_EQ(axis_filter(3840, 480).texels(7).first, 56u);
  EXPECT_EQ(axis_filter(3840, 480).texels(7).last, 64u);
}

TEST(AxisFilter, HasTheWeightsOfLanczosInsideOfTheFrame) {
  for (const auto& [from, to] : kAxes) {
    const AxisFilter filter = axis_filter(from, to);
    if (filter.mean > 0) continue;
    SCOPED_TRACE(::testing::Message() << from << " to " << to);
    const double stretch = std::max(1.0, 1.0 * from / to);
    TexelRange before;
    for (uint32_t i = 0; i < to; ++i) {
      const TexelRange range = filter.texels(i), lobe = filter.main_lobe(i);
      ASSERT_LT(range.first, range.last);
      ASSERT_LE(range.last, from);
      ASSERT_LE(range.last - range.first, filter.taps);
      ASSERT_LE(range.first, lobe.first);
      ASSERT_LT(lobe.first, lobe.last);
      ASSERT_LE(lobe.last, range.last);
      ASSERT_GE(range.first, before.first);
      ASSERT_GE(range.last, before.last);
      before = range;
      const auto t = [&](double k) { return (k + 0.5 - (i + 0.5) * from / to) / stretch; };
      double sum = 0;
      for (uint32_t k = range.first; k < range.last; ++k) sum += sinc(t(k)) * sinc(t(k) / 3);
      double total = 0;
      for (uint32_t k = range.first; k < range.last; ++k) {
        const float weight = filter.weights_of(i)[k - range.first];
        ASSERT_NEAR(weight, sinc(t(k)) * sinc(t(k) / 3) / sum, 1e-7) << "texel " << k << " of " << i;
        ASSERT_EQ(k >= lobe.first && k < lobe.last, std::abs(t(k)) < 1 - 1e-12);
        total += weight;
      }
      ASSERT_NEAR(total, 1, 1e-6);
      // All texels that the filter reaches, and no others.
      ASSERT_TRUE(range.first == 0 || t(range.first - 1.0) <= -3 + 1e-9);
      ASSERT_TRUE(range.last == from || t(range.last) >= 3 - 1e-9);
      if (i > 100 && i + 100 < to && to > 1000) i += 37;
    }
  }
}

TEST(AxisFilter, KeepsTexelsThatKeepTheirPlace) {
  // The middle of 3 is the middle of 5.
  const AxisFilter filter = axis_filter(3, 5);
  const float* const weights = filter.weights_of(2);
  EXPECT_FLOAT_EQ(weights[1], 1);
  EXPECT_EQ(weights[0], 0);
  EXPECT_EQ(weights[2], 0);
}

// Exposure over time: docs/pipeline.md section 3. No device.

constexpr v1::Adaptation::Domain kDomains[] = {v1::Adaptation::DOMAIN_LINEAR, v1::Adaptation::DOMAIN_LOG};

TEST(Adaptation, AFirstFrameTakesItsTarget) {
  for (v1::Adaptation::Domain domain : kDomains)
    EXPECT_EQ(adapt_exposure(testing::adaptation(domain, 3, 1), std::nullopt, 0.7), 0.7);
}

TEST(Adaptation, FollowsItsFormula) {
  const double up = 1 - std::exp(-0.25 * 3.0);
  const double down = 1 - std::exp(-0.25 * 1.0);
  const auto step = [](v1::Adaptation::Domain domain, double from, double to) {
    return adapt_exposure(testing::adaptation(domain, 3.0, 1.0), PreviousExposure{from, 0.25}, to);
  };
  EXPECT_NEAR(step(v1::Adaptation::DOMAIN_LINEAR, 1, 5), 1 + 4 * up, 1e-14);
  EXPECT_NEAR(step(v1::Adaptation::DOMAIN_LINEAR, 5, 1), 5 - 4 * down, 1e-14);
  EXPECT_NEAR(step(v1::Adaptation::DOMAIN_LOG, 1, 16), std::exp2(4 * up), 1e-13);
  EXPECT_NEAR(step(v1::Adaptation::DOMAIN_LOG, 16, 1), 16 * std::exp2(-4 * down), 1e-13);
}

TEST(Adaptation, TwoStepsAreOneOfTheirTime) {
  for (v1::Adaptation::Domain domain : kDomains) {
    for (double speed : {1e-9, 0.3, 3.0, 1000.0}) {
      for (double from : {0x1p-40, 0.015625, 1.0, 64.0, 0x1p40}) {
        for (double to : {0x1p-40, 0.18, 1.0, 0x1p40}) {
          for (double a : {0.0, 1e-9, 1.0 / 24, 10.0, 1e9}) {
            for (double b : {1e-9, 1.0 / 60, 3.0}) {
              const v1::Adaptation settings = testing::adaptation(domain, speed, speed);
              const double half = adapt_exposure(settings, PreviousExposure{from, a}, to);
              const double twice = adapt_exposure(settings, PreviousExposure{half, b}, to);
              const double once = adapt_exposure(settings, PreviousExposure{from, a + b}, to);
              EXPECT_NEAR(twice / once, 1.0, 1e-12) << static_cast<int>(domain) << " " << speed << " " << from
                                                    << " to " << to << " in " << a << " + " << b;
              EXPECT_LE(once, std::max(from, to));
              EXPECT_GE(once, std::min(from, to));
            }
          }
        }
      }
    }
  }
}

TEST(Adaptation, NoTimeChangesNothingAndAllTimeArrives) {
  for (v1::Adaptation::Domain domain : kDomains) {
    EXPECT_EQ(adapt_exposure(testing::adaptation(domain, 1000, 1000), PreviousExposure{0.3, 0.0}, 50.0), 0.3);
    EXPECT_EQ(adapt_exposure(testing::adaptation(domain, 0, 0), PreviousExposure{0.3, 1e9}, 50.0), 0.3);
    EXPECT_EQ(adapt_exposure(testing::adaptation(domain, 3, 1), PreviousExposure{0.3, 1e9}, 50.0), 50.0);
    EXPECT_EQ(adapt_exposure(testing::adaptation(domain, 3, 1), PreviousExposure{0.3, 1e9}, 0.3), 0.3);
  }
}

TEST(Adaptation, PreviousStateIsChecked) {
  EXPECT_OK(check_previous({1.0, 0.0}));
  for (const PreviousExposure& bad :
       {PreviousExposure{0, 1}, {-1, 1}, {NAN, 1}, {INFINITY, 1}, {1, -1e-9}, {1, NAN}, {1, 1e10}}) {
    EXPECT_EQ(check_previous(bad).code(), absl::StatusCode::kInvalidArgument)
        << bad.exposure << " " << bad.elapsed_seconds;
  }
  EXPECT_EQ(check_previous({1, -2}).message(),
            "previous.elapsed_seconds is -2; it must be between 0 and 1e+09: time does not run backwards");
}

TEST(CenterWeights, AreTheirFormulaRounded) {
  const std::vector<uint32_t> weights = center_weights();
  ASSERT_EQ(weights.size(), 256u);
  for (uint32_t i = 0; i < 256; ++i) {
    const long double exact = 255 * std::exp(-2.0L * i / 256);
    EXPECT_EQ(weights[i], std::lround(exact)) << i;
    // No error of an exponential could round another way.
    EXPECT_GT(std::fabs(exact - std::floor(exact) - 0.5L), 1e-5L) << i;
  }
}

// The host's decisions: sizes, limits, settings, primaries, exposure, plan. No device.

TEST(Frame, IsRefusedBeyondTheLimitsWithoutOverflow) {
  const FrameLimits limits = {16384, uint64_t{1} << 29};
  EXPECT_OK(check_frame({7680, 4320, v1::PIXEL_FORMAT_RGBA16F}, limits));
  EXPECT_EQ(check_frame({0, 5, v1::PIXEL_FORMAT_RGBA16F}, limits).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(check_frame({16385, 1, v1::PIXEL_FORMAT_RGBA16F}, limits).code(),
            absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(check_frame({16384, 16384, v1::PIXEL_FORMAT_RGBA32F}, limits).code(),
            absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(
      check_frame({UINT32_MAX, UINT32_MAX, v1::PIXEL_FORMAT_RGBA32F}, {UINT32_MAX, uint64_t{1} << 40}).code(),
      absl::StatusCode::kResourceExhausted);
}

TEST(Bloom, LevelsEndBeforeTheShortSideIsUnderTwo) {
  const auto count = [](uint32_t w, uint32_t h, uint32_t n) { return bloom_level_sizes(w, h, n, 2).size(); };
  EXPECT_EQ(count(1, 1, 5), 1u);
  EXPECT_EQ(count(16384, 1, 5), 1u);
  EXPECT_EQ(count(4, 4, 5), 1u);  // 2x2, and 1x1 would follow
  EXPECT_EQ(count(5, 5, 5), 2u);  // 3x3, 2x2
  EXPECT_EQ(count(1920, 1080, 5), 5u);
  EXPECT_EQ(count(1920, 1080, 16), 10u);
  const LevelSize odd = bloom_level_sizes(333, 517, 2, 2)[1];
  EXPECT_EQ(odd.width, 84u);
  EXPECT_EQ(odd.height, 130u);
}

TEST(Settings, NameTheFieldItsValueAndItsRange) {
  const auto message = [](auto change) {
    v1::Settings settings;
    change(settings);
    return std::string(Settings::from(settings).status().message());
  };
  EXPECT_OK(Settings::from({}));
  EXPECT_EQ(message([](v1::Settings& s) { s.mutable_bloom()->set_intensity(11); }),
            "bloom.intensity is 11; it must be between 0 and 10");
  EXPECT_EQ(message([](v1::Settings& s) { s.mutable_bloom()->set_levels(0); }),
            "bloom.levels is 0; it must be between 1 and 16");
  EXPECT_NE(message([](v1::Settings& s) { s.mutable_exposure()->set_key(NAN); }), "");
  EXPECT_NE(message([](v1::Settings& s) { s.set_prescale(INFINITY); }), "");
  EXPECT_NE(message([](v1::Settings& s) { s.mutable_exposure()->set_min_exposure(0); }), "");
  EXPECT_NE(message([](v1::Settings& s) { s.mutable_exposure()->set_min_exposure(65); }), "");
  EXPECT_TRUE(says(message([](v1::Settings& s) { s.set_tier("best"); }), "standard"));
  EXPECT_NE(message([](v1::Settings& s) { s.mutable_input_chromaticities(); }), "");
}

TEST(Primaries, MatchThePublishedMatrices) {
  // ITU-R BT.2087-0: Rec.2020 to Rec.709.
  const auto rec2020 = matrix_to_rec709({{0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290}});
  ASSERT_TRUE(rec2020.ok() && rec2020->has_value());
  const double expected2020[9] = {1.6605,  -0.5876, -0.0728, -0.1246, 1.1329,
                                  -0.0083, -0.0182, -0.1006, 1.1187};
  for (size_t i = 0; i < 9; ++i) EXPECT_NEAR((**rec2020)[i], expected2020[i], 1e-4) << i;
  // IEC 61966-2-1: XYZ to linear sRGB, four digits.
  const auto xyz = matrix_to_rec709({{1, 0, 0, 1, 0, 0, 1.0 / 3, 1.0 / 3}});
  ASSERT_TRUE(xyz.ok() && xyz->has_value());
  const double expected_xyz[9] = {3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570};
  for (size_t i = 0; i < 9; ++i) EXPECT_NEAR((**xyz)[i], expected_xyz[i], 5e-4) << i;
  // White stays white after adaptation: ACES AP0.
  const auto ap0 = matrix_to_rec709({{0.7347, 0.2653, 0, 1, 0.0001, -0.0770, 0.32168, 0.33767}});
  ASSERT_TRUE(ap0.ok() && ap0->has_value());
  for (size_t r = 0; r < 3; ++r) {
    EXPECT_NEAR((**ap0)[3 * r] + (**ap0)[3 * r + 1] + (**ap0)[3 * r + 2], 1.0, 1e-5);
  }
}

TEST(Primaries, OfRec709NeedNoMatrixAndSingularOnesAreRefused) {
  ASSERT_OK_AND_ASSIGN(const auto rec709,
                       matrix_to_rec709({{0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}}));
  EXPECT_FALSE(rec709.has_value());
  EXPECT_FALSE(matrix_to_rec709({{0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3}}).ok());
  EXPECT_FALSE(matrix_to_rec709({{0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0}}).ok());
  // The primaries are independent, but the matrix would exceed a float's range.
  EXPECT_FALSE(matrix_to_rec709({{-0.7238643181910811, -5.97e-216, -4.97e+272, -3.74e-159,
                                  -0.081465836816720816, -1.41e-139, 6.4829e-06, 0.69833}})
                   .ok());
  EXPECT_FALSE(matrix_to_rec709({{NAN, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290}}).ok());
}

TEST(Exposure, FollowsTheKeyWithinItsLimits) {
  v1::Exposure settings = Settings()->exposure();
  EXPECT_DOUBLE_EQ(exposure_target(settings, std::log2(0.18)), 1.0);
  settings.set_compensation_ev(1);
  EXPECT_DOUBLE_EQ(exposure_target(settings, std::log2(0.18)), 2.0);
  EXPECT_DOUBLE_EQ(exposure_target(settings, -100), 64.0);
  EXPECT_DOUBLE_EQ(exposure_target(settings, 100), 1.0 / 64);
  settings.set_mode(v1::Exposure::MODE_MANUAL);
  settings.set_manual_ev(10);
  EXPECT_DOUBLE_EQ(exposure_target(settings, 3), 1024.0);
}

TEST(Plan, HoldsOnlyWhatTheFrameNeeds) {
  const FrameDesc desc = {1920, 1080, v1::PIXEL_FORMAT_RGBA16F};
  FrameStats stats;
  stats.max_luminance = 0.5f;
  stats.tile_light.assign(30 * 17, 0.25f);
  const auto plan_of = [&](const v1::Settings& settings, bool scrubbed = false) {
    const Settings complete = testing::checked(settings);
    return plan_frame(layout_textures(desc, complete), {stats, scrubbed}, complete, {});
  };
  EXPECT_FALSE(plan_of({}).bloom());
  EXPECT_EQ(plan_of({}).words[1], "no bloom: nothing passes the threshold 1 (the brightest is 0.5)");

  stats.tile_light[31] = 3.0f;
  v1::Settings settings;
  settings.mutable_bloom()->set_levels(3);
  const std::vector<std::pair<Pass, uint32_t>> bright = {{Pass::kBrightPass, 0},
                                                         {Pass::kBloomDown, 1},
                                                         {Pass::kBloomDown, 2},
                                                         {Pass::kBloomUp, 1},
                                                         {Pass::kBloomUp, 0}};
  const Plan plan = plan_of(settings);
  std::vector<std::pair<Pass, uint32_t>> steps;
  for (const BloomStep& step : plan.bloom_steps) steps.emplace_back(step.pass, step.level);
  EXPECT_EQ(steps, bright);
  EXPECT_EQ(plan.lit, (std::vector<Box>{{64, 64, 128, 128}}));
  EXPECT_EQ(plan.words[1],
            "bloom over 3 levels from 960x540 to 240x135: light in 0.2 % of the frame's tiles");
  settings.mutable_bloom()->set_intensity(0);
  EXPECT_FALSE(plan_of(settings).bloom());
  EXPECT_EQ(plan_of(settings, false).resolve.inputs.constants.scrub, 0u);
  EXPECT_EQ(plan_of(settings, true).resolve.inputs.constants.scrub, 1u);
}

// The table of docs/pipeline.md section 5, published by the curves' authors or computed from their
// definitions.
TEST(ToneCurve, HasItsPublishedValueAtOne) {
  const auto at_one = [](uint32_t curve) { return reference::tone_curve(curve, {1, 1, 1})[1]; };
  EXPECT_DOUBLE_EQ(at_one(shader::CURVE_LINEAR), 1.0);
  EXPECT_DOUBLE_EQ(at_one(shader::CURVE_REINHARD), 0.5);
  EXPECT_NEAR(at_one(shader::CURVE_ACES_NARKOWICZ), 0.803797, 1e-6);
  EXPECT_NEAR(at_one(shader::CURVE_ACES_HILL), 0.619115, 1e-5);
  EXPECT_DOUBLE_EQ(at_one(shader::CURVE_REINHARD_EXTENDED), 0.53125);
  EXPECT_NEAR(at_one(shader::CURVE_HABLE), 0.492919, 1e-6);
  EXPECT_NEAR(at_one(shader::CURVE_PBR_NEUTRAL), 0.869091, 1e-6);
  EXPECT_DOUBLE_EQ(at_one(shader::CURVE_SHOULDER), 0.755102040816326530612);  // of a source of 4: 37 / 49
  const reference::Rgb agx = reference::tone_curve(shader::CURVE_AGX, {1, 1, 1});
  EXPECT_NEAR(agx[0], 0.591281, 1e-6);
  EXPECT_NEAR(agx[1], 0.591239, 1e-6);
  EXPECT_NEAR(agx[2], 0.591237, 1e-6);
}

TEST(Transfer, OfTheReferenceIsTheStandards) {
  EXPECT_DOUBLE_EQ(reference::transfer(shader::TRANSFER_SRGB, 1.0), 1.0);
  EXPECT_NEAR(reference::transfer(shader::TRANSFER_SRGB, 0.0031308), 0.040450, 1e-6);
  EXPECT_NEAR(reference::transfer(shader::TRANSFER_SRGB, 0.214041), 0.5, 1e-6);
  EXPECT_DOUBLE_EQ(reference::transfer(shader::TRANSFER_GAMMA22, 0.25), std::pow(0.25, 1 / 2.2));
}

}  // namespace
}  // namespace candela
