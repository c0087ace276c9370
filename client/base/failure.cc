#include "client/base/failure.h"

#include <utility>

#include "absl/strings/cord.h"

namespace candela {
namespace {

constexpr char kKind[] = "candela.failure_kind";
constexpr char kInputPath[] = "candela.failure_input";

}  // namespace

absl::Status failure_of(FailureKind kind, absl::Status status) {
  if (status.GetPayload(kKind)) return status;
  const char letter = static_cast<char>('0' + static_cast<int>(kind));
  status.SetPayload(kKind, absl::Cord(absl::string_view(&letter, 1)));  // does nothing to OK
  return status;
}

FailureKind kind_of(const absl::Status& status) {
  const absl::optional<absl::Cord> kind = status.GetPayload(kKind);
  return kind ? static_cast<FailureKind>((*kind)[0] - '0') : FailureKind::kOther;
}

absl::Status about_input(absl::Status status, const std::string& path) {
  if (!path.empty() && !status.GetPayload(kInputPath)) status.SetPayload(kInputPath, absl::Cord(path));
  return status;
}

absl::Status input_failure(const absl::Status& status, const std::string& path) {
  return about_input(failure_of(FailureKind::kInput, status), path);
}

std::string input_of(const absl::Status& status) {
  return std::string(status.GetPayload(kInputPath).value_or(absl::Cord()));
}

absl::Status reworded(const absl::Status& status, absl::string_view words) {
  absl::Status other(status.code(), words);
  status.ForEachPayload(
      [&other](absl::string_view type, const absl::Cord& payload) { other.SetPayload(type, payload); });
  return other;
}

void add_failure(std::optional<FailureKind>& all, const absl::Status& one) {
  const FailureKind kind = kind_of(one);
  all = all.value_or(kind) == kind ? kind : FailureKind::kOther;
}

}  // namespace candela
