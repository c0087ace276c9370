#include "client/base/failure.h"

#include <new>
#include <system_error>
#include <utility>

#include "absl/strings/cord.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "server/base/words.h"

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

absl::Status system_failure(const std::exception& error) {
  if (dynamic_cast<const std::bad_alloc*>(&error) != nullptr) {
    return absl::ResourceExhaustedError(
        "out of memory; render a smaller image, or give this process more memory (ulimit -v)");
  }
  const auto* const system = dynamic_cast<const std::system_error*>(&error);
  if (system != nullptr && system->code() == std::errc::resource_unavailable_try_again) {
    return absl::ResourceExhaustedError(absl::StrFormat(
        "cannot start a thread: %s; allow this process more threads or memory (ulimit -u, ulimit -v)",
        system->code().message()));
  }
  return absl::InternalError(error.what());
}

absl::Status usage_error(const std::string& message) {
  return failure_of(FailureKind::kUsage, absl::InvalidArgumentError(message));
}

bool is_usage_error(const absl::Status& status) { return kind_of(status) == FailureKind::kUsage; }

absl::Status empty_value(const std::string& option) {
  return usage_error(absl::StrFormat("%s is empty; leave it out or give it a value", option));
}

absl::Status unknown_word(const std::string& what, const std::string& typed,
                          const std::vector<std::string>& words) {
  const std::string meant = did_you_mean(near_words(typed, words));
  return usage_error(
      absl::StrFormat("unknown %s \"%s\"; %s %s", what, typed,
                      meant.empty() ? "there are:" : meant + " There are:", absl::StrJoin(words, ", ")));
}

}  // namespace candela
