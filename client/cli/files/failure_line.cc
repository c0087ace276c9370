#include "client/cli/files/failure_line.h"

#include <nlohmann/json.hpp>

namespace candela {
namespace {

struct End {
  int code;
  const char* word;
};

End end_of(FailureKind kind) {
  switch (kind) {
    case FailureKind::kUsage:
      return {2, "usage"};
    case FailureKind::kInput:
      return {3, "input"};
    case FailureKind::kServer:
      return {4, "server"};
    case FailureKind::kOutput:
      return {5, "output"};
    case FailureKind::kOther:
      break;
  }
  return {1, "other"};
}

}  // namespace

std::string line_of(const nlohmann::ordered_json& json) {
  return json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

int exit_code(FailureKind kind) { return end_of(kind).code; }

std::string failure_line(const absl::Status& status) {
  const End end = end_of(kind_of(status));
  const std::string input = input_of(status);
  const nlohmann::ordered_json error = {
      {"code", end.code},
      {"kind", end.word},
      {"message", std::string(status.message())},
      {"input", input.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(input)}};
  return line_of({{"error", error}});
}

}  // namespace candela
