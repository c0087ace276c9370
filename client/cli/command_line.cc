#include "client/cli/command_line.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"
#include "client/base/failure.h"
#include "client/cli/options/option_kinds.h"
#include "client/cli/terminal.h"
#include "server/base/status_macros.h"
#include "server/base/words.h"

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

#ifndef CANDELA_VERSION
#error "the build sets CANDELA_VERSION"
#endif

namespace candela {
namespace {

constexpr char kExamples[] =
    "Examples:\n"
    "  candela sample scene.exr              make a scene to try things on\n"
    "  candela render scene.exr scene.png    render it here, without a server\n"
    "  candela render 'in/*.exr' out/         render each image for itself\n"
    "  candela stream 'in/*.exr' out/%04d.png  render a sequence, exposure adapting over time\n"
    "  candela view pano.hdr view.png        look into a panorama\n"
    "  candela info                          describe the device this machine renders on\n"
    "`candela help COMMAND` lists a command's options. $CANDELA_SERVER is the default of --server.\n"
    "Exit codes: 2 wrong usage, 3 an input, 4 the server or the device, 5 an output, 1 anything else.";

using Finishes = std::map<const CLI::App*, Finish>;

// The help of a command, or of the whole program for null. CLI11 leaves two empty lines between sections, and
// marks OUT as repeatable with the inputs.
std::string help(const CLI::App& app, const CLI::App* command) {
  const CLI::App& shown = command == nullptr ? app : *command;
  const std::string name = command == nullptr ? app.get_name() : app.get_name() + " " + command->get_name();
  const std::string text = app.get_formatter()->make_help(&shown, name, CLI::AppFormatMode::Normal);
  return absl::StrReplaceAll(text, {{"\n\n\n", "\n\n"}, {"OUT...", "OUT"}});
}

ParsedCommand print_text(std::string text) {
  ParsedCommand printing;
  printing.run = [text = std::move(text)](JsonOutput&) { return print(text); };
  return printing;
}

Finish define_help(CLI::App& app, CLI::App& own) {
  const auto topic = std::make_shared<std::string>();
  own.add_option("COMMAND", *topic, "One of the commands (default: all of them, in short)")->option_text(" ");
  return [&app, topic](const GivenOptions&) -> absl::StatusOr<ParsedCommand> {
    if (topic->empty()) return print_text(help(app, nullptr));
    const auto named = [&topic](const CLI::App* known) { return known->check_name(*topic); };
    const std::vector<const CLI::App*> found = std::as_const(app).get_subcommands(named);
    if (found.empty()) return unknown_word("command", *topic, command_names(app));
    return print_text(help(app, found.front()));
  };
}

Finishes define(CLI::App& app, std::span<const Command* const> commands) {
  app.require_subcommand(0, 1);
  app.get_formatter()->column_width(32);
  app.get_formatter()->label("SUBCOMMAND", "COMMAND");
  app.get_formatter()->label("Positionals", "Arguments");
  app.set_help_flag("--help,-h", "Print this help and exit");
  app.set_version_flag("--version", "candela " CANDELA_VERSION, "Print the version and exit");
  app.footer(kExamples);
  Finishes finishes;
  for (const Command* command : commands) {
    CLI::App& own = *app.add_subcommand(command->name, command->about)->group("Commands");
    own.footer(command->examples);
    finishes[&own] = command->define(own);
  }
  CLI::App& own = *app.add_subcommand("help", "Prints the help of a command.")->group("Commands");
  finishes[&own] = define_help(app, own);
  return finishes;
}

// The options on the command line and their values.
GivenOptions given_options(const std::vector<std::string>& words) {
  GivenOptions given;
  for (size_t i = 0; i < words.size() && words[i] != "--"; ++i) {
    if (!absl::StartsWith(words[i], "--")) continue;
    const std::pair<std::string, std::string> parts = absl::StrSplit(words[i], absl::MaxSplits('=', 1));
    const bool own_word = parts.first == words[i] && i + 1 < words.size();
    given[parts.first] = own_word ? words[i + 1] : parts.second;
  }
  return given;
}

// CLI11's own message, in one line.
absl::Status refused(const CLI::App& app, const CLI::Error& error) {
  const std::vector<CLI::App*> commands = app.get_subcommands();
  std::string what = error.what();
  what = what.substr(0, what.find('\n'));
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) {
    what = what.substr(0, what.find(':')) + " needs a value";
  }
  if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr && !commands.empty()) {
    what = absl::StrFormat("\"%s\" is one argument too many", app.remaining(true).back());
  }
  return usage_error(absl::StrFormat("%s; see candela%s --help", what,
                                     commands.empty() ? "" : " " + commands.front()->get_name()));
}

// The words for CLI11, last one first. All words after "--" are paths. CLI11 gives them to no list of files,
// so "--" is left out, and a path that begins with "-" gets "./" before it.
std::vector<std::string> for_parser(const std::vector<std::string>& words) {
  const auto mark = std::find(words.begin(), words.end(), "--");
  std::vector<std::string> parsed(words.begin(), mark);
  for (auto word = mark; word != words.end(); ++word) {
    if (word != mark) parsed.push_back(absl::StartsWith(*word, "-") ? "./" + *word : *word);
  }
  std::reverse(parsed.begin(), parsed.end());
  return parsed;
}

}  // namespace

std::string json_path_in(const std::vector<std::string>& words) {
  const GivenOptions given = given_options(words);
  const auto json = given.find("--json");
  const bool is_path = json != given.end() && (json->second == "-" || !absl::StartsWith(json->second, "-"));
  return is_path ? json->second : "";
}

absl::StatusOr<ParsedCommand> parse_command_line(const std::vector<std::string>& words,
                                                 std::span<const Command* const> commands) {
  CLI::App app("candela: renders HDR images for a display, here or on a server.\n", "candela");
  const Finishes finishes = define(app, commands);
  RETURN_IF_ERROR(check_words(app, words));
  const auto asked = [&app]() -> const CLI::App* {
    const std::vector<CLI::App*> parsed = app.get_subcommands();
    return parsed.empty() ? nullptr : parsed.front();
  };
  try {
    app.parse(for_parser(words));
    if (asked() == nullptr) return print_text(help(app, nullptr));
    return finishes.at(asked())(given_options(words));
  } catch (const CLI::CallForHelp&) {
    return print_text(help(app, asked()));
  } catch (const CLI::CallForVersion& version) {
    return print_text(absl::StrFormat("%s\n", version.what()));
  } catch (const CLI::Error& error) {
    return refused(app, error);
  } catch (const OptionError& error) {
    return error.status;
  }
}

}  // namespace candela
