// Who makes the passes in the tests.
#pragma once

#include "server/render/passes.h"

namespace candela::testing {

// What CANDELA_TEST_PASSES says, device or host; otherwise auto.
Passes passes_of_environment();

}  // namespace candela::testing
