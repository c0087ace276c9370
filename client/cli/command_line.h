// The command line's grammar: its words are checked before CLI11 parses them, which would report only what
// follows from them.
#pragma once

#include <CLI/App.hpp>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/cli/json_output.h"
#include "client/run/options.h"

namespace candela {

std::vector<std::string> command_names(const CLI::App& app);

// A usage error for an unknown command, an unknown option, or an option where a value should be. `words` are
// the arguments without the program's name.
absl::Status check_words(const CLI::App& app, const std::vector<std::string>& words);

// The command line's grammar, for a table of commands.

// A command as it was asked for, parsed and checked.
struct ParsedCommand {
  // Does it: prints what it did, unless --quiet is set, and returns its failure. It returns a usage error
  // (client/base/failure.h) if only the work shows that an option is wrong. It opens the destination of
  // --json after it has checked its outputs, and closes it if it succeeds.
  std::function<absl::Status(JsonOutput&)> run;
  std::string json;  // the destination of --json
  bool quiet = false;
  std::optional<ServerChoice> server;
  bool is_probe = false;  // failures have no kind
};

// Runs `options` with `run`, which takes a JsonOutput, too, or not.
template <typename Options, typename RunOptions>
ParsedCommand parsed_command(const Options& options, RunOptions run) {
  ParsedCommand made;
  made.run = [options, run]([[maybe_unused]] JsonOutput& json) -> absl::Status {
    if constexpr (std::is_invocable_v<RunOptions, const Options&, JsonOutput&>) {
      return run(options, json);
    } else {
      return run(options);
    }
  };
  if constexpr (requires { options.json; }) made.json = options.json;
  if constexpr (requires { options.quiet; }) made.quiet = options.quiet;
  if constexpr (requires { options.server; }) made.server = options.server;
  return made;
}

using GivenOptions = std::map<std::string, std::string>;  // "--key" on the command line, and its value
// Checks what was parsed, and says what to run.
using Finish = std::function<absl::StatusOr<ParsedCommand>(const GivenOptions&)>;

// A row of the table.
struct Command {
  const char* name;
  const char* about;  // a sentence for the help
  const char* examples;
  Finish (*define)(CLI::App& app);  // defines its options
};

// Reads nothing but its arguments, which are those after the program's name. Every failure is a usage error
// (client/base/failure.h) of one line that says how to correct the command.
absl::StatusOr<ParsedCommand> parse_command_line(const std::vector<std::string>& words,
                                                 std::span<const Command* const> commands);

// The destination of --json in arguments that cannot be parsed; "" if there is none.
std::string json_path_in(const std::vector<std::string>& words);

}  // namespace candela
