// What must hold at run time, in release builds too.
#pragma once

#include <cstdio>
#include <cstdlib>

namespace candela {

[[noreturn]] inline void check_failed(const char* condition, const char* file, int line) {
  std::fprintf(stderr, "%s:%d: CHECK(%s) failed\n", file, line, condition);
  std::abort();
}

}  // namespace candela

// Writes the condition to stderr and aborts if it is false. For what only a mistake in this program can break.
#define CHECK(...) \
  ((__VA_ARGS__) ? static_cast<void>(0) : ::candela::check_failed(#__VA_ARGS__, __FILE__, __LINE__))
