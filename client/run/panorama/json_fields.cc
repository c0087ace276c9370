#include "client/run/panorama/json_fields.h"

#include <cstddef>
#include <vector>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/base/failure.h"
#include "client/call/security/plain_file.h"
#include "proto/candela/v1/settings.h"
#include "server/base/words/near_words.h"

namespace candela {
namespace {

constexpr size_t kMaxBytes = size_t{1} << 20;

bool is_within(const nlohmann::json& value, v1::Range<double> range) {
  return value.is_number() && value.get<double>() >= range.min && value.get<double>() <= range.max;
}

}  // namespace

absl::StatusOr<nlohmann::json> read_json(const std::string& path, const std::string& what) {
  const absl::StatusOr<std::string> text = read_plain_file(path, kMaxBytes);
  if (!text.ok()) {
    return input_failure(
        reworded(text.status(),
                 absl::StrFormat("%s: cannot read this file of %s: %s; `candela view --help` shows one", path,
                                 what, text.status().message())),
        path);
  }
  nlohmann::json json = nlohmann::json::parse(*text, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object()) {
    return input_failure(
        absl::InvalidArgumentError(absl::StrFormat(
            "%s: it holds no JSON object; `candela view --help` shows a file of %s", path, what)),
        path);
  }
  return json;
}

void JsonFields::allow(std::initializer_list<const char*> members) {
  if (!object_.is_object()) {
    status_.Update(absl::InvalidArgumentError(
        absl::StrFormat("%s must be a JSON object", name_.substr(0, name_.size() - 1))));
    return;
  }
  const std::vector<std::string> known(members.begin(), members.end());
  for (const auto& [key, value] : object_.items()) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    const std::string meant = did_you_mean(near_words(key, known));
    status_.Update(absl::InvalidArgumentError(
        absl::StrFormat("unknown key %s%s; %s", name_, key,
                        meant.empty() ? "there are: " + absl::StrJoin(known, ", ") : meant)));
  }
}

double JsonFields::number(const char* key, v1::Range<double> range, std::optional<double> absent) {
  const nlohmann::json* value = member(key);
  if (value == nullptr && absent) return *absent;
  if (value != nullptr && is_within(*value, range)) return value->get<double>();
  fail(key, "a number, " + v1::format_range(range.min, range.max));
  return range.min;
}

std::array<double, 3> JsonFields::triple(const char* key, v1::Range<double> range,
                                         std::optional<std::array<double, 3>> absent) {
  const nlohmann::json* value = member(key);
  if (value == nullptr && absent) return *absent;
  std::array<double, 3> numbers{};
  bool good = value != nullptr && value->is_array() && value->size() == numbers.size();
  for (size_t i = 0; good && i < numbers.size(); ++i) {
    good = is_within((*value)[i], range);
    if (good) numbers[i] = (*value)[i].get<double>();
  }
  if (!good) fail(key, "an array of three numbers, " + v1::format_range(range.min, range.max));
  return numbers;
}

bool JsonFields::flag(const char* key, bool absent) {
  const nlohmann::json* value = member(key);
  if (value == nullptr) return absent;
  if (!value->is_boolean()) fail(key, "true or false");
  return value->is_boolean() && value->get<bool>();
}

const nlohmann::json& JsonFields::array(const char* key, size_t least, size_t most) {
  static const nlohmann::json kEmpty = nlohmann::json::array();
  const nlohmann::json* value = member(key);
  if (value != nullptr && value->is_array() && value->size() >= least && value->size() <= most) return *value;
  fail(key, absl::StrFormat("an array of %d to %d objects", least, most));
  return kEmpty;
}

void JsonFields::fail(const std::string& key, const std::string& wanted) {
  constexpr size_t kShown = 40;
  const nlohmann::json* found = member(key.c_str());
  std::string value =
      found == nullptr ? "missing" : found->dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  if (value.size() > kShown) value = value.substr(0, kShown) + "...";
  status_.Update(
      absl::InvalidArgumentError(absl::StrFormat("%s%s is %s; it must be %s", name_, key, value, wanted)));
}

const nlohmann::json* JsonFields::member(const char* key) const {
  return object_.is_object() && object_.contains(key) ? &object_.at(key) : nullptr;
}

}  // namespace candela
