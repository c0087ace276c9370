// Lines of JSON, and how a failed command ends: its exit code, and its failure as such a line.
// docs/failures.md is for users.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "absl/status/status.h"
#include "client/base/failure.h"

namespace candela {

// A value as one line of JSON, with a line end. Invalid UTF-8, which a path may have, is replaced.
std::string line_of(const nlohmann::ordered_json& json);

// 2 usage, 3 input, 4 server, 5 output, 1 other.
int exit_code(FailureKind kind);

// {"error": {"code": 3, "kind": "input", "message": "...", "input": "in.exr"}} as one line, with a line end.
// `code` is the exit code; `input` is null if the failure is about none.
std::string failure_line(const absl::Status& status);

}  // namespace candela
