// A function that returns absl::Status or absl::StatusOr ends with the first error.
#pragma once

#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#define CANDELA_JOIN_(a, b) a##b
#define CANDELA_JOIN(a, b) CANDELA_JOIN_(a, b)

// RETURN_IF_ERROR(status);
#define RETURN_IF_ERROR(...) RETURN_IF_ERROR_(CANDELA_JOIN(status_, __COUNTER__), __VA_ARGS__)
#define RETURN_IF_ERROR_(status, ...)                                     \
  do {                                                                    \
    if (absl::Status status = (__VA_ARGS__); !status.ok()) return status; \
  } while (false)

// ASSIGN_OR_RETURN(const Image image, read(path)); ASSIGN_OR_RETURN(image_, read(path));
// The first argument holds no comma: a type that has one needs a name.
#define ASSIGN_OR_RETURN(left, ...) \
  ASSIGN_OR_RETURN_(CANDELA_JOIN(status_or_, __COUNTER__), left, __VA_ARGS__)
#define ASSIGN_OR_RETURN_(result, left, ...) \
  auto result = (__VA_ARGS__);               \
  if (!result.ok()) return result.status();  \
  left = *std::move(result)
