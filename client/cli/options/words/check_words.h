// Finds words of a command line that mean nothing, before CLI11 parses it: CLI11 would report only what
// follows from them.
#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"

namespace candela {

std::vector<std::string> command_names(const CLI::App& app);

// A usage error for an unknown command, an unknown option, or an option where a value should be. `words` are
// the arguments without the program's name.
absl::Status check_words(const CLI::App& app, const std::vector<std::string>& words);

}  // namespace candela
