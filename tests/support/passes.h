// Who makes the passes in the tests.
#pragma once

#include "server/render/executor_kind.h"

namespace candela::testing {

// The passes that the variable CANDELA_TEST_EXECUTOR names, device or host. Without it, auto.
ExecutorKind executor_of_environment();

}  // namespace candela::testing
