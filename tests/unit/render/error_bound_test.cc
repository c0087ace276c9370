// The error bounds of the tiers, as docs/pipeline.md section 6 publishes them. No device.
#include "server/render/settings/error_bound.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "server/render/color/aces.h"
#include "shaders/reference.h"
#include "tests/support/status.h"

namespace candela {
namespace {

const Tier& draft() { return *find_tier("draft"); }
const Tier& standard() { return *find_tier("standard"); }
const Tier& reference_tier() { return *find_tier("reference"); }

Settings settings_of(const v1::Settings& message) { return *Settings::from(message); }

TEST(ErrorBound, AreAsPublished) {
  const BoundFacts plain = {.exposure = 1, .threshold = 1};
  BoundFacts blooms = plain;
  blooms.blooms = true;
  EXPECT_LE(error_bound(draft(), {}, plain), 0.1);
  EXPECT_EQ(error_bound(draft(), {}, blooms), kNoBound);
  EXPECT_LE(error_bound(standard(), {}, plain), 0.01);
  EXPECT_LE(error_bound(standard(), {}, blooms), 0.03);
  EXPECT_EQ(error_bound(reference_tier(), {}, hardest_facts({64, 64}, {})), 0.0);
}

// 1/2.2 has an infinite slope at 0, where these curves subtract.
TEST(ErrorBound, OfStandardAreAsPublishedForGamma22) {
  const BoundFacts plain = {.exposure = 1, .threshold = 1};
  double largest = 0;
  for (const v1::ToneCurve curve :
       {v1::TONE_CURVE_PBR_NEUTRAL, v1::TONE_CURVE_ACES_HILL, v1::TONE_CURVE_AGX}) {
    v1::Settings message;
    message.set_curve(curve);
    message.set_transfer(v1::TRANSFER_GAMMA22);
    const double bound = error_bound(standard(), settings_of(message), plain);
    EXPECT_LE(bound, 1.3) << curve;
    largest = std::max(largest, bound);
  }
  EXPECT_GE(largest, 0.12);  // an error that was found
}

TEST(ErrorBound, NoTierIsWorseThanTheOnesBeforeIt) {
  for (int curve = 1; curve <= v1::TONE_CURVE_ACES_2; ++curve) {
    if (curve == v1::TONE_CURVE_TABLE) continue;
    for (int transfer = 1; transfer <= 3; ++transfer) {
      v1::Settings message;
      message.set_curve(static_cast<v1::ToneCurve>(curve));
      message.set_transfer(static_cast<v1::Transfer>(transfer));
      const Settings settings = settings_of(message);
      for (const BoundFacts& facts :
           {easiest_facts(), BoundFacts{.blooms = true, .exposure = 4, .threshold = 1},
            BoundFacts{.wide = true, .exposure = 1, .negative_light = 1}}) {
        double before = kNoBound;
        for (const Tier& tier : tiers()) {
          const double bound = error_bound(tier, settings, facts);
          EXPECT_LE(bound, before) << tier.name << " curve " << curve << " transfer " << transfer;
          before = bound;
        }
      }
    }
  }
}

// What makes an error larger makes its bound larger.
TEST(ErrorBound, GrowsWithWhatItDependsOn) {
  const auto bound = [](const BoundFacts& facts) { return error_bound(standard(), {}, facts); };
  const BoundFacts blooms = {.blooms = true, .exposure = 1, .threshold = 1};
  BoundFacts brighter = blooms;
  brighter.exposure = 1000;
  EXPECT_GT(bound(brighter), bound(blooms));
  BoundFacts higher = blooms;
  higher.threshold = 1000;
  EXPECT_GT(bound(higher), bound(blooms));
  BoundFacts wide = {.wide = true, .exposure = 1, .negative_light = 1};
  BoundFacts wider = wide;
  wider.negative_light = 1000;
  EXPECT_GT(bound(wider), bound(wide));
  wider.negative_light = INFINITY;
  EXPECT_EQ(bound(wider), kNoBound);
}

TEST(ErrorBound, TheRowsInQuestionBeginAndEndWhereABoundDecides) {
  const auto names = [](double codes, v1::PixelFormat format) {
    v1::Settings message;
    message.set_max_error_codes(codes);
    std::string all;
    for (const Tier& tier : tiers_in_question({64, 64, format}, settings_of(message))) all += tier.name[0];
    return all;
  };
  EXPECT_EQ(names(255, v1::PIXEL_FORMAT_RGBA16F), "d");
  EXPECT_EQ(names(7, v1::PIXEL_FORMAT_RGBA16F), "dsr");
  EXPECT_EQ(names(0.05, v1::PIXEL_FORMAT_RGBA16F), "sr");
  EXPECT_EQ(names(0, v1::PIXEL_FORMAT_RGBA16F), "r");
  v1::Settings message;
  message.set_max_error_codes(0.5);
  message.mutable_bloom()->set_intensity(0);
  // Without bloom and negative components every frame is within draft's bound, and no reference is reserved.
  EXPECT_EQ(tiers_in_question({64, 64, v1::PIXEL_FORMAT_RGB9E5}, settings_of(message)).size(), 1u);
}

using Color = std::array<float, 3>;

// Searches for the worst colour of a table of aces-1, from random ones uphill.
class WorstColor {
 public:
  WorstColor(const ColorTable& table, uint32_t transfer, bool wide)
      : table_(table), transfer_(transfer), wide_(wide) {}

  double search(int climbs) {
    double worst = 0;
    for (int i = 0; i < climbs; ++i) worst = std::max(worst, climb());
    return worst;
  }

 private:
  double uniform(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  // log2 of a component; -16 stands for 0.
  double component(double around) {
    if (uniform(0, 1) < 0.2) return -16;
    return uniform(0, 1) < 0.5 ? around + uniform(-2, 2) : uniform(-14, 14);
  }

  double error(const reference::Rgb& stops) const {
    reference::Rgb light{};
    for (size_t k = 0; k < 3; ++k) light[k] = stops[k] <= -15.9 ? 0.0 : std::exp2(stops[k]);
    if (wide_) {  // from ACES AP1
      static constexpr double kToRec709[9] = {1.70505,  -0.62179, -0.08326, -0.13026, 1.14080,
                                              -0.01055, -0.02400, -0.12897, 1.15297};
      const reference::Rgb ap1 = light;
      for (size_t r = 0; r < 3; ++r) {
        light[r] = kToRec709[3 * r] * ap1[0] + kToRec709[3 * r + 1] * ap1[1] + kToRec709[3 * r + 2] * ap1[2];
      }
    }
    Color truth = {static_cast<float>(light[0]), static_cast<float>(light[1]), static_cast<float>(light[2])};
    const reference::Rgb shown = reference::look_up(table_, {truth[0], truth[1], truth[2]});
    if (!aces_1(truth).ok()) return 0;
    double worst = 0;
    for (size_t k = 0; k < 3; ++k) {
      const double want = reference::transfer(transfer_, std::clamp<double>(truth[k], 0, 1));
      worst =
          std::max(worst, std::abs(reference::transfer(transfer_, std::clamp(shown[k], 0.0, 1.0)) - want));
    }
    return 255 * worst;
  }

  double climb() {
    reference::Rgb at{};
    double worst = -1;
    for (int i = 0; i < 50; ++i) {
      const double around = uniform(-14, 14);
      const reference::Rgb c = {component(around), component(around), component(around)};
      if (const double e = error(c); e > worst) {
        worst = e;
        at = c;
      }
    }
    int failures = 0;
    for (double step = 1; step > 1e-3;) {
      reference::Rgb c = at;
      c[static_cast<size_t>(uniform(0, 2.999))] += uniform(-2, 2) * step;
      if (const double e = error(c); e > worst) {
        worst = e;
        at = c;
        failures = 0;
      } else if (++failures > 20) {
        step /= 2;
        failures = 0;
      }
    }
    return worst;
  }

  const ColorTable& table_;
  const uint32_t transfer_;
  const bool wide_;
  std::mt19937_64 random_{5};
};

TEST(ErrorBound, NoColourIsBeyondTheErrorOfATable) {
  for (const Tier* tier : {&draft(), &standard()}) {
    for (const bool wide : {false, true}) {
      ASSERT_OK_AND_ASSIGN(const auto table,
                           wide ? aces_1_wide_table(tier->wide_table_size) : aces_1_table(tier->table_size));
      const TableError& bound = wide ? tier->wide_table_codes : tier->table_codes;
      for (const auto& [transfer, codes] : {std::pair{shader::TRANSFER_SRGB, bound.srgb},
                                            {shader::TRANSFER_GAMMA22, bound.gamma22},
                                            {shader::TRANSFER_LINEAR, bound.linear}}) {
        const double worst = WorstColor(*table, transfer, wide).search(300);
        std::printf("%-9s %s transfer %u: %.3f of %.3g codes\n", tier->name, wide ? "AP1" : "own", transfer,
                    worst, codes);
        EXPECT_LE(worst, codes) << tier->name << " wide " << wide << " transfer " << transfer;
        EXPECT_GE(worst, codes / 4) << "the bound says little, or the search is weak";
      }
    }
  }
}

}  // namespace
}  // namespace candela
