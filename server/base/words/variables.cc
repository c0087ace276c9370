#include "server/base/words/variables.h"

#include <unistd.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "server/base/words/near_words.h"

namespace candela {
namespace {

constexpr absl::string_view kPrefix = "CANDELA_";

constexpr const char* kCommandVariables[] = {kServerVariable,   kTlsVariable,     kTlsCaVariable,
                                             kTlsNameVariable,  kTlsCertVariable, kTlsKeyVariable,
                                             kTokenFileVariable};

// Variables of the scripts and tests of this project.
constexpr absl::string_view kOwnToolPrefixes[] = {"CANDELA_DATA",  "CANDELA_DEPLOY_",
                                                  "CANDELA_FUZZ_", "CANDELA_SOAK_SECONDS",
                                                  "CANDELA_TEST_", "CANDELA_UPDATE_PAGES"};

// CANDELA_SERVICE_HOST=10.0.0.1, CANDELA_PORT=tcp://10.0.0.1:50051, CANDELA_PORT_50051_TCP_PROTO=tcp
bool is_service_link(absl::string_view name, absl::string_view value) {
  if (absl::StrContains(name, "_SERVICE_HOST") || absl::StrContains(name, "_SERVICE_PORT")) return true;
  if (absl::StartsWith(value, "tcp://") || absl::StartsWith(value, "udp://")) return true;
  const size_t digit = name.find("_PORT_") + absl::string_view("_PORT_").size();
  return absl::StrContains(name, "_PORT_") && digit < name.size() && absl::ascii_isdigit(name[digit]);
}

bool is_of_own_tools(absl::string_view name) {
  return std::any_of(std::begin(kOwnToolPrefixes), std::end(kOwnToolPrefixes),
                     [name](absl::string_view prefix) { return absl::StartsWith(name, prefix); });
}

}  // namespace

std::vector<UnknownVariable> unknown_variables(const std::vector<std::string>& daemon_variables) {
  std::vector<std::string> known;
  for (const char* name : kCommandVariables) known.emplace_back(absl::StripPrefix(name, kPrefix));
  for (const std::string& name : daemon_variables) known.emplace_back(absl::StripPrefix(name, kPrefix));
  std::map<std::string, std::string> unknown;
  for (char** entry = environ; entry != nullptr && *entry != nullptr; ++entry) {
    const std::pair<absl::string_view, absl::string_view> variable =
        absl::StrSplit(*entry, absl::MaxSplits('=', 1));
    absl::string_view name = variable.first;
    if (is_service_link(name, variable.second) || is_of_own_tools(name)) continue;
    if (!absl::ConsumePrefix(&name, kPrefix)) continue;
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    std::vector<std::string> near = near_words(name, known);
    for (std::string& word : near) word = absl::StrCat(kPrefix, word);
    unknown.emplace(variable.first, did_you_mean(std::move(near)));
  }
  std::vector<UnknownVariable> result;
  for (const auto& [name, words] : unknown) result.push_back({name, words});
  return result;
}

}  // namespace candela
