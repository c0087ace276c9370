#include "tests/support/passes.h"

#include <cstdlib>

namespace candela::testing {

ExecutorKind executor_of_environment() {
  const char* word = std::getenv("CANDELA_TEST_EXECUTOR");
  return word == nullptr ? ExecutorKind::kAuto : parse_executor(word).value();
}

}  // namespace candela::testing
