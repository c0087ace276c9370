#include "server/daemon/config_file.h"

#include <algorithm>
#include <map>
#include <sstream>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include "server/base/words/near_words.h"

namespace candela {
namespace {

const Option& option_named(const std::string& key, int line) {
  std::vector<std::string> names;
  for (const Option& option : option_table()) {
    if (key == option.name) return option;
    names.emplace_back(option.name);
  }
  const std::string meant = did_you_mean(near_words(key, names));
  throw ConfigLineError{line, absl::StrFormat("unknown key \"%s\"; %ssee candelad --print-config", key,
                                              meant.empty() ? "" : meant + " ")};
}

}  // namespace

std::vector<CLI::ConfigItem> ConfigFile::from_config(std::istream& input) const {
  std::vector<CLI::ConfigItem> read;
  std::map<std::string, int> lines;  // of the keys
  std::string text;
  for (int line = 1; std::getline(input, text); ++line) {
    if (absl::StartsWith(absl::StripLeadingAsciiWhitespace(text), "[")) {
      throw ConfigLineError{
          line, absl::StrCat("the section ", text, " is not known; write lines KEY = VALUE alone")};
    }
    std::istringstream one(text);
    for (CLI::ConfigItem& item : CLI::ConfigTOML::from_config(one)) {
      const std::string key = item.fullname();
      const Option& option = option_named(key, line);
      const auto [first, fresh] = lines.emplace(key, line);
      if (!fresh) {
        throw ConfigLineError{
            line, absl::StrFormat("%s is given in line %d, too; remove one of them", key, first->second)};
      }
      if (item.inputs.size() > 1 && !std::holds_alternative<AddressListOption>(option.kind)) {
        throw ConfigLineError{
            line, absl::StrFormat("%s has %d values; write one, in quotes", key, item.inputs.size())};
      }
      item.inputs = {absl::StrJoin(item.inputs, ",")};
      if (absl::Status status = check_(option, item.inputs.front()); !status.ok()) {
        throw ConfigLineError{line, std::string(status.message())};
      }
      read.push_back(std::move(item));
    }
  }
  return read;
}

}  // namespace candela
