// Exposure over time: docs/pipeline.md section 3. No device.
#include "server/render/plan/exposure.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/settings.h"
#include "tests/support/status.h"

namespace candela {
namespace {

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

}  // namespace
}  // namespace candela
