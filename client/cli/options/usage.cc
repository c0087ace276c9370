#include "client/cli/options/usage.h"

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "proto/candela/v1/near_words.h"

namespace candela {
namespace {

constexpr char kUsagePayload[] = "candela.usage";

}  // namespace

absl::Status usage_error(const std::string& message) {
  absl::Status status = absl::InvalidArgumentError(message);
  status.SetPayload(kUsagePayload, absl::Cord());
  return status;
}

bool is_usage_error(const absl::Status& status) { return status.GetPayload(kUsagePayload).has_value(); }

absl::Status empty_value(const std::string& option) {
  return usage_error(absl::StrFormat("%s is empty; leave it out or give it a value", option));
}

absl::Status unknown_word(const std::string& what, const std::string& typed,
                          const std::vector<std::string>& words) {
  const std::string meant = v1::did_you_mean(v1::near_words(typed, words));
  return usage_error(
      absl::StrFormat("unknown %s \"%s\"; %s %s", what, typed,
                      meant.empty() ? "there are:" : meant + " There are:", absl::StrJoin(words, ", ")));
}

}  // namespace candela
