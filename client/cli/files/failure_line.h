// How a failed command ends: its exit code, and its failure as JSON. docs/failures.md is for users.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "client/base/failure.h"

namespace candela {

// 2 usage, 3 input, 4 server, 5 output, 1 other.
int exit_code(FailureKind kind);

// {"error": {"code": 3, "kind": "input", "message": "...", "input": "in.exr"}} as one line, with a line end.
// `code` is the exit code; `input` is null if the failure is about none.
std::string failure_line(const absl::Status& status);

}  // namespace candela
