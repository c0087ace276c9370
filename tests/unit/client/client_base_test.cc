// What failures carry, and numbers in sentences.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "client/base/failure.h"
#include "client/base/number_words.h"
#include "tests/support/status.h"

namespace candela {
namespace {

TEST(FailureKinds, TheCauseKnowsBest) {
  const absl::Status full = failure_of(FailureKind::kOutput, absl::UnavailableError("full"));
  EXPECT_EQ(kind_of(failure_of(FailureKind::kServer, full)), FailureKind::kOutput);
  EXPECT_EQ(
      kind_of(failure_of(FailureKind::kServer, failure_of(FailureKind::kOther, absl::UnknownError("")))),
      FailureKind::kOther);
  EXPECT_EQ(kind_of(absl::UnavailableError("lost")), FailureKind::kOther);
  EXPECT_OK(failure_of(FailureKind::kInput, absl::OkStatus()));
}

TEST(FailureKinds, OtherWordsKeepKindAndInput) {
  const absl::Status bad = input_failure(absl::NotFoundError("gone"), "a\nb.exr");
  const absl::Status said = reworded(bad, "a file is gone");
  EXPECT_EQ(said.message(), "a file is gone");
  EXPECT_EQ(said.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(kind_of(said), FailureKind::kInput);
  EXPECT_EQ(input_of(about_input(said, "another")), "a\nb.exr");
  EXPECT_EQ(input_of(absl::NotFoundError("gone")), "");
}

TEST(FailureKinds, SeveralHaveTheirCommonKind) {
  std::optional<FailureKind> all;
  add_failure(all, failure_of(FailureKind::kInput, absl::UnknownError("")));
  EXPECT_EQ(all, FailureKind::kInput);
  add_failure(all, failure_of(FailureKind::kInput, absl::UnknownError("")));
  EXPECT_EQ(all, FailureKind::kInput);
  add_failure(all, failure_of(FailureKind::kServer, absl::UnknownError("")));
  EXPECT_EQ(all, FailureKind::kOther);
  add_failure(all, failure_of(FailureKind::kServer, absl::UnknownError("")));
  EXPECT_EQ(all, FailureKind::kOther);
}

TEST(NumberWords, HaveNoExponent) {
  EXPECT_EQ(in_digits(100, 2), "100");
  EXPECT_EQ(in_digits(99.7, 2), "100");
  EXPECT_EQ(in_digits(0.0851, 3), "0.0851");
  EXPECT_EQ(in_digits(16384, 4), "16384");
  EXPECT_EQ(in_digits(1638412.5, 4), "1638412");
  EXPECT_EQ(in_digits(0.00001, 3), "0.00001");
  EXPECT_EQ(in_digits(0.000012345, 3), "0.0000123");
  EXPECT_EQ(in_digits(-0.0, 3), "0");
  EXPECT_EQ(in_digits(std::exp2(-40), 4), "9.095e-13");
  EXPECT_EQ(in_digits(std::exp2(40), 4), "1099511627776");
  EXPECT_EQ(in_digits(std::numeric_limits<double>::infinity(), 4), "inf");
  EXPECT_EQ(in_digits(std::nan(""), 4), "nan");
}

TEST(NumberWords, HaveNoMinusBeforeZero) {
  EXPECT_EQ(in_decimals(-0.001, 2), "0.00");
  EXPECT_EQ(in_decimals(-0.006, 2), "-0.01");
  EXPECT_EQ(with_sign(-0.001, 2), "+0.00");
  EXPECT_EQ(with_sign(0.32, 2), "+0.32");
  EXPECT_EQ(with_sign(-1.25, 2), "-1.25");
  EXPECT_EQ(with_sign(-std::numeric_limits<double>::infinity(), 2), "-inf");
}

}  // namespace
}  // namespace candela
