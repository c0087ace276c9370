#include <gtest/gtest.h>

#include <string>

#include "server/base/words.h"

namespace candela::v1 {
namespace {

TEST(RoundedUp, HasThreeDigits) {
  EXPECT_EQ(rounded_up(0), "0");
  EXPECT_EQ(rounded_up(1), "1");
  EXPECT_EQ(rounded_up(0.1), "0.1");
  EXPECT_EQ(rounded_up(0.02731), "0.0274");
  EXPECT_EQ(rounded_up(0.02739), "0.0274");
  EXPECT_EQ(rounded_up(6.331), "6.34");
  EXPECT_EQ(rounded_up(9.991), "10");
  EXPECT_EQ(rounded_up(254.1), "255");
  EXPECT_EQ(rounded_up(1.231e-300), "1.24e-300");
  EXPECT_EQ(rounded_up(1.231e300), "1.24e+300");
}

TEST(RoundedUp, IsNeverBelowTheBoundAndNearIt) {
  for (double bound = 1e-9; bound < 1e3; bound *= 1.0137) {
    const double number = std::stod(rounded_up(bound));
    EXPECT_GE(number, bound);
    EXPECT_LE(number, bound * 1.0101);
  }
}

}  // namespace
}  // namespace candela::v1
