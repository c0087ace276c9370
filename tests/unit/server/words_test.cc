// Words that do not exist, and the variables of the environment that nothing reads.
#include "server/base/words.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

#include "tests/support/process.h"

namespace candela::v1 {
namespace {

using Words = std::vector<std::string>;

const Words kCurves = {"linear", "reinhard", "aces-narkowicz", "aces-hill", "reinhard-extended",
                       "hable",  "aces-1"};

TEST(NearWords, AreTheOnesWithTheFewestWrongLetters) {
  EXPECT_EQ(near_words("aces-hil", kCurves), Words{"aces-hill"});
  EXPECT_EQ(near_words("reinhrad", kCurves), Words{"reinhard"});
  EXPECT_EQ(near_words("haple", kCurves), Words{"hable"});
  EXPECT_EQ(near_words("aces-3", kCurves), Words{"aces-1"});
  EXPECT_EQ(near_words("abc", {"abd", "abe", "xyz"}), (Words{"abd", "abe"}));
}

TEST(NearWords, OrTheOnesThatBeginLikeThat) {
  EXPECT_EQ(near_words("aces", kCurves), (Words{"aces-narkowicz", "aces-hill", "aces-1"}));
  EXPECT_EQ(near_words("rein", kCurves), (Words{"reinhard", "reinhard-extended"}));
  EXPECT_EQ(near_words("b", {"ba-one", "bb-two", "bc-three", "bd-four", "be-five"}), Words{});
}

TEST(NearWords, DoNotDependOnCaseAndPunctuation) {
  EXPECT_EQ(folded("Rec.709"), "rec709");
  EXPECT_EQ(folded("ACES2065-1"), "aces20651");
  EXPECT_EQ(near_words("ACES_HIL", kCurves), Words{"aces-hill"});
}

TEST(NearWords, AreNotFarOnes) {
  for (const char* far : {"", "-", "filmic", "zzz", "q"}) EXPECT_EQ(near_words(far, kCurves), Words{}) << far;
}

TEST(NearWords, AreNamedInASentence) {
  EXPECT_EQ(did_you_mean({}), "");
  EXPECT_EQ(did_you_mean({"a"}), "did you mean a?");
  EXPECT_EQ(did_you_mean({"a", "b"}), "did you mean a or b?");
  EXPECT_EQ(did_you_mean({"a", "b", "c"}), "did you mean a, b or c?");
}

TEST(UnknownVariables, AreNamedWithTheOneThatIsNear) {
  ASSERT_TRUE(unknown_variables({}).empty()) << unknown_variables({}).front().name;
  const Variable server("CANDELA_SEVER", "a:1"), calls("CANDELA_MAX_CALL", "3"), other("CANDELA_ZZZ", ""),
      right("CANDELA_SERVER", "a:1"), daemon("CANDELA_MAX_CALLS", "3");
  const std::vector<UnknownVariable> unknown = unknown_variables({"CANDELA_MAX_CALLS"});
  ASSERT_EQ(unknown.size(), 3u);
  EXPECT_EQ(unknown[0].name, "CANDELA_MAX_CALL");
  EXPECT_EQ(unknown[0].words, "did you mean CANDELA_MAX_CALLS?");
  EXPECT_EQ(unknown[1].name, "CANDELA_SEVER");
  EXPECT_EQ(unknown[1].words, "did you mean CANDELA_SERVER?");
  EXPECT_EQ(unknown[2].name, "CANDELA_ZZZ");
  EXPECT_EQ(unknown[2].words, "");
}

// Kubernetes sets these in every pod if a Service's name begins with candela.
TEST(UnknownVariables, LinksOfKubernetesAndTheProjectsOwnAreKnown) {
  const Variable host("CANDELA_SERVICE_HOST", "10.0.0.1"), port("CANDELA_SERVICE_PORT_GRPC", "50051"),
      link("CANDELA_PORT", "tcp://10.0.0.1:50051"), tcp("CANDELA_METRICS_PORT_9464_TCP_ADDR", "10.0.0.1"),
      data("CANDELA_DATA", "/data"), test("CANDELA_TEST_CACHE", "1");
  EXPECT_TRUE(unknown_variables({}).empty()) << unknown_variables({}).front().name;
  const Variable typed("CANDELA_PORT", "50051");
  EXPECT_EQ(unknown_variables({}).size(), 1u);
}

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
