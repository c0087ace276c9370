#include "client/cli/options/words/check_words.h"

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/usage.h"
#include "server/base/status_macros.h"
#include "server/base/words/near_words.h"

namespace candela {
namespace {

// Options that other programs have, and what does here what they mean.
constexpr std::pair<const char*, const char*> kOfOthers[] = {
    {"-o", "the output is the last argument"},
    {"--output", "the output is the last argument"},
    {"--out", "the output is the last argument"},
    {"-i", "the input is an argument by itself"},
    {"--input", "the input is an argument by itself"},
    {"--gamma", "--transfer gamma22 is that of a display"},
    {"--tonemap", "--curve chooses the tone curve"},
    {"--tonemapper", "--curve chooses the tone curve"},
    {"--ev", "--exposure takes EV"},
    {"--colorspace", "--primaries are those of the input"},
    {"--resize", "an image keeps its size"},
    {"--scale", "an image keeps its size; --prescale multiplies its light"},
    {"--view", "--ocio-view names a view of --ocio, --exr-view one of an OpenEXR file"},
    {"--view", "--exr-view names a view of an OpenEXR file"},
    {"--start", "--range chooses frames"},
    {"--end", "--range chooses frames"},
    {"--frames", "--range chooses frames"}};

// "did you mean --exposure? ", or "--curve chooses the tone curve; "; "" if nothing is like it.
std::string meant_option(const std::string& name, const std::vector<std::string>& known) {
  const auto has = [&known](absl::string_view words) {
    const std::string option(words.substr(0, words.find(' ')));
    return !absl::StartsWith(option, "--") || std::find(known.begin(), known.end(), option) != known.end();
  };
  for (const auto& [other, words] : kOfOthers) {
    if (name == other && has(words)) return absl::StrCat(words, "; ");
  }
  const std::string meant = did_you_mean(near_words(name, known));
  return meant.empty() ? "" : meant + " ";
}

std::vector<std::string> option_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::Option* option : app.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

// Refuses an option where the value of another option should be. A number may begin with a minus.
absl::Status check_value(const CLI::App& command, const CLI::Option& option, const std::string& value) {
  const bool is_option = absl::StartsWith(value, "--") || command.get_option_no_throw(value) != nullptr;
  if (!absl::StartsWith(value, "-") || value == "-" || !is_option) return absl::OkStatus();
  const std::string name = "--" + option.get_lnames().front();
  const std::string& values = option.get_option_text();
  const std::string way_out = absl::EndsWith(values, "|-")
                                  ? absl::StrFormat("write %s - for stdout", name)
                                  : absl::StrFormat("if it is meant, write %s=%s", name, value);
  return usage_error(
      absl::StrFormat("%s needs a value, %s, but %s is an option; %s", name, values, value, way_out));
}

}  // namespace

std::vector<std::string> command_names(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
  return names;
}

absl::Status check_words(const CLI::App& app, const std::vector<std::string>& words) {
  if (words.empty()) return absl::OkStatus();
  const CLI::App* command = &app;
  size_t at = 0;
  if (!absl::StartsWith(words[0], "-")) {
    const auto named = [&words](const CLI::App* known) { return known->check_name(words[0]); };
    const std::vector<const CLI::App*> found = app.get_subcommands(named);
    if (found.empty()) {
      return unknown_word("command", words[0], command_names(app));
    }
    command = found.front();
    at = 1;
  }
  for (; at < words.size() && words[at] != "--"; ++at) {
    if (!absl::StartsWith(words[at], "-") || words[at] == "-") continue;
    const std::string name = words[at].substr(0, words[at].find('='));
    const CLI::Option* option = command->get_option_no_throw(name);
    if (option != nullptr) {
      const bool takes_value = option->get_items_expected_min() > 0;
      // CLI11 would take the next word.
      if (takes_value && words[at] == name + "=") return empty_value(name);
      const bool needs_value = takes_value && name == words[at];
      if (!needs_value || at + 1 == words.size()) continue;
      RETURN_IF_ERROR(check_value(*command, *option, words[++at]));
      continue;
    }
    return usage_error(absl::StrFormat("unknown option %s; %ssee candela%s --help", name,
                                       meant_option(name, option_names(*command)),
                                       command == &app ? "" : " " + command->get_name()));
  }
  return absl::OkStatus();
}

}  // namespace candela
