// Tests of functions that return absl::Status, absl::StatusOr or grpc::Status, and of what messages say.
#pragma once

#include <gtest/gtest.h>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"
#include "server/base/status_macros.h"

// ASSERT_OK(write(path)); EXPECT_OK(client.finish()) << name;
#define ASSERT_OK(...) ASSERT_TRUE(::candela::testing::is_ok(::candela::testing::status_of(__VA_ARGS__)))
#define EXPECT_OK(...) EXPECT_TRUE(::candela::testing::is_ok(::candela::testing::status_of(__VA_ARGS__)))

// EXPECT_REFUSED(kNotFound, id, connection.render({}, frame)); The message has to hold the words.
#define EXPECT_REFUSED(code, words, ...)                                    \
  EXPECT_TRUE(::candela::testing::is_refused(absl::StatusCode::code, words, \
                                             ::candela::testing::status_of(__VA_ARGS__)))

// ASSERT_OK_AND_ASSIGN(const Image image, read(path)); The first argument holds no comma.
#define ASSERT_OK_AND_ASSIGN(left, ...) \
  ASSERT_OK_AND_ASSIGN_(CANDELA_JOIN(status_or_, __COUNTER__), left, __VA_ARGS__)
#define ASSERT_OK_AND_ASSIGN_(result, left, ...)                       \
  auto result = (__VA_ARGS__);                                         \
  ASSERT_TRUE(result.ok()) << #__VA_ARGS__ << ": " << result.status(); \
  left = *std::move(result)

namespace candela {

// EXPECT_TRUE(says(outcome.err, "no such file")); A failure shows the text.
inline ::testing::AssertionResult says(absl::string_view text, absl::string_view words) {
  const bool so = absl::StrContains(text, words);
  return (so ? ::testing::AssertionSuccess() : ::testing::AssertionFailure())
         << '"' << words << "\" is " << (so ? "" : "not ") << "in: " << text;
}

namespace testing {

template <typename Result>
absl::Status status_of(const Result& result) {
  if constexpr (requires { result.error_message(); }) {  // grpc::Status, whose codes have the same numbers
    return {static_cast<absl::StatusCode>(result.error_code()), result.error_message()};
  } else if constexpr (requires { result.status(); }) {
    return result.status();
  } else {
    return result;
  }
}

inline ::testing::AssertionResult is_ok(const absl::Status& status) {
  return (status.ok() ? ::testing::AssertionSuccess() : ::testing::AssertionFailure()) << status;
}

inline ::testing::AssertionResult is_refused(absl::StatusCode code, absl::string_view words,
                                             const absl::Status& status) {
  const bool so = status.code() == code && absl::StrContains(status.message(), words);
  return (so ? ::testing::AssertionSuccess() : ::testing::AssertionFailure())
         << status << "; expected " << absl::StatusCodeToString(code) << " and \"" << words << '"';
}

}  // namespace testing
}  // namespace candela
