// Tests of functions that return absl::Status or absl::StatusOr.
#pragma once

#include <gtest/gtest.h>

#include "server/base/status_macros.h"

#define ASSERT_OK(...) ASSERT_OK_(CANDELA_JOIN(status_, __COUNTER__), __VA_ARGS__)
#define ASSERT_OK_(status, ...)                                 \
  do {                                                          \
    const absl::Status status = (__VA_ARGS__);                  \
    ASSERT_TRUE(status.ok()) << #__VA_ARGS__ << ": " << status; \
  } while (false)

// ASSERT_OK_AND_ASSIGN(const Image image, read(path)); The first argument holds no comma.
#define ASSERT_OK_AND_ASSIGN(left, ...) \
  ASSERT_OK_AND_ASSIGN_(CANDELA_JOIN(status_or_, __COUNTER__), left, __VA_ARGS__)
#define ASSERT_OK_AND_ASSIGN_(result, left, ...)                       \
  auto result = (__VA_ARGS__);                                         \
  ASSERT_TRUE(result.ok()) << #__VA_ARGS__ << ": " << result.status(); \
  left = *std::move(result)
