#include "tests/support/passes.h"

#include <cstdlib>

namespace candela::testing {

Passes passes_of_environment() {
  const char* word = std::getenv("CANDELA_TEST_PASSES");
  return word == nullptr ? Passes::kAuto : parse_passes(word).value();
}

}  // namespace candela::testing
