#include "client/base/usage.h"

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/failure.h"
#include "server/base/words/near_words.h"

namespace candela {

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
