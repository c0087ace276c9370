// Runs the built `candela` as a user would.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace candela {

struct Outcome {
  int code = -1;  // exit code, or 128 + the number of the signal that ended it
  std::string out;
  std::string err;
  long peak_kib = 0;  // largest resident memory, KiB
};

// These arguments, and then those.
inline std::vector<std::string> with(std::vector<std::string> arguments,
                                     const std::vector<std::string>& more) {
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

// Runs `candela` with these arguments and waits for it. A run of more than two minutes is killed and fails
// the test.
Outcome candela(const std::vector<std::string>& arguments);

// Returns the JSON object that `candela ... --json -` prints. Fails the test unless the exit code is 0.
nlohmann::json candela_json(std::vector<std::string> arguments);

// Starts `candela`, sends it `signal` after `ms` milliseconds, and waits for its end.
Outcome candela_with_signal(const std::vector<std::string>& arguments, int signal, int ms);

// Like candela(), started by a shell after the command `before`, such as "exec >&-".
Outcome candela_in_shell(const std::string& before, const std::vector<std::string>& arguments);

// Like candela(), under a limit of the shell, such as "-v 600000" (KiB) or "-f 8" (blocks of 512 bytes).
Outcome candela_with_ulimit(const std::string& limit, const std::vector<std::string>& arguments);

// Like candela(), on a machine with the failure that `variable` = `value` chooses in failing_machine.cc.
Outcome candela_on_failing_machine(const char* variable, const char* value,
                                   const std::vector<std::string>& arguments);

}  // namespace candela
