// The choice of a tier that keeps a promise. No device.
#include "server/render/settings/tier_choice.h"

#include <gtest/gtest.h>

namespace candela {
namespace {

const TierNumbers kNumbers[] = {{"draft", 15, 4}, {"standard", 20, 0.01}, {"reference", 3000, 0}};

absl::StatusOr<TierChoice> choose(std::optional<double> codes, std::optional<double> ms,
                                  std::span<const TierNumbers> numbers = kNumbers) {
  v1::Settings settings;
  if (codes) settings.set_max_error_codes(*codes);
  if (ms) settings.set_max_ms(*ms);
  return choose_tier(numbers, settings);
}

TEST(TierChoice, TakesTheFastestThatIsAccurateEnough) {
  EXPECT_EQ(choose(10, std::nullopt)->tier, "draft");
  EXPECT_EQ(choose(4, std::nullopt)->tier, "draft");
  EXPECT_EQ(choose(3.9, std::nullopt)->tier, "standard");
  EXPECT_EQ(choose(0.001, std::nullopt)->tier, "reference");
  EXPECT_EQ(choose(0, std::nullopt)->tier, "reference");
}

TEST(TierChoice, WithATimeAloneTakesTheMostAccurate) {
  EXPECT_EQ(choose(std::nullopt, 16)->tier, "draft");
  EXPECT_EQ(choose(std::nullopt, 20)->tier, "standard");
  EXPECT_EQ(choose(std::nullopt, 1e6)->tier, "reference");
}

TEST(TierChoice, KeepsBothWhereBothAreGiven) {
  EXPECT_EQ(choose(0.5, 25)->tier, "standard");
  EXPECT_EQ(choose(10, 25)->tier, "draft");
}

TEST(TierChoice, SaysWhatWasChosenAndWhy) {
  EXPECT_EQ(
      choose(0.5, std::nullopt)->reason,
      "standard takes 20 ms with at most 0.01 codes of error, as measured here; it keeps max_error_codes "
      "0.5; draft "
      "takes 15 ms with at most 4 codes of error, reference takes 3e+03 ms with at most 0 codes of error");
}

TEST(TierChoice, RefusesTheImpossibleWithTheNearest) {
  const absl::Status slow = choose(std::nullopt, 1).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(slow));
  EXPECT_EQ(slow.message(),
            "no tier keeps max_ms 1 for frames of this size with these settings on this device; closest: "
            "draft takes "
            "15 ms with at most 4 codes of error");
  const absl::Status both = choose(0.5, 18).status();
  EXPECT_NE(both.message().find("max_error_codes 0.5 with max_ms 18"), std::string::npos) << both;
  EXPECT_NE(both.message().find("standard takes 20 ms"), std::string::npos) << both;
  const TierNumbers rough[] = {kNumbers[0], kNumbers[1]};
  EXPECT_NE(choose(0.001, std::nullopt, rough).status().message().find("standard takes 20 ms"),
            std::string::npos);
}

}  // namespace
}  // namespace candela
