// The choice of a tier that keeps max_ms. No device.
#include "server/render/settings/tier_choice.h"

#include <gtest/gtest.h>

namespace candela {
namespace {

const TierNumbers kNumbers[] = {{"draft", 15}, {"standard", 20}, {"reference", 3000}};

absl::StatusOr<TierChoice> choose(std::optional<double> codes, double ms) {
  v1::Settings settings;
  if (codes) settings.set_max_error_codes(*codes);
  settings.set_max_ms(ms);
  return choose_by_time(kNumbers, *Settings::from(settings));
}

TEST(TierChoice, WithATimeAloneTakesTheMostAccurate) {
  EXPECT_EQ(choose(std::nullopt, 16)->tier, "draft");
  EXPECT_EQ(choose(std::nullopt, 20)->tier, "standard");
  EXPECT_EQ(choose(std::nullopt, 1e6)->tier, "reference");
}

TEST(TierChoice, WithAnErrorTooTakesTheMostAccurateThatAFrameMayHave) {
  EXPECT_EQ(choose(0.5, 25)->tier, "standard");
  EXPECT_EQ(choose(10, 16)->tier, "draft");
  EXPECT_EQ(choose(0, 1e6)->tier, "reference");
}

TEST(TierChoice, SaysWhatWasChosenAndWhy) {
  EXPECT_EQ(choose(std::nullopt, 25)->reason,
            "standard takes 20 ms, the median measured here; it keeps max_ms 25; draft takes 15 ms, "
            "reference takes "
            "3e+03 ms");
}

TEST(TierChoice, RefusesTheImpossibleWithTheNearest) {
  const absl::Status slow = choose(std::nullopt, 1).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(slow));
  EXPECT_EQ(slow.message(),
            "no tier keeps max_ms 1 for frames of this size with these settings on this device; closest: "
            "draft takes "
            "15 ms");
  // Draft can never be so accurate.
  const absl::Status both = choose(0.05, 18).status();
  EXPECT_NE(both.message().find("max_error_codes 0.05 with max_ms 18"), std::string::npos) << both;
  EXPECT_NE(both.message().find("standard takes 20 ms"), std::string::npos) << both;
}

}  // namespace
}  // namespace candela
