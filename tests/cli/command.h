// Running the built programs as a user does.
#pragma once

#include <sys/types.h>

#include <csignal>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace candela {

struct Outcome {
  int code = -1;  // exit code, or 128 + the signal that ended it
  std::string out;
  std::string err;
  long peak_kib = 0;  // resident memory at its largest
};

// Runs `candela` with these arguments and waits for it; one that takes over two minutes is killed.
Outcome candela(const std::vector<std::string>& arguments);

// The one object of `--json -`.
nlohmann::json candela_json(std::vector<std::string> arguments);

// Starts `candela`, sends it `signal` after `ms` milliseconds and waits for it.
Outcome candela_with_signal(const std::vector<std::string>& arguments, int signal, int ms);

// As candela(), on a machine that fails as failing_machine.cc says `variable` = `value` does.
Outcome candela_on_failing_machine(const char* variable, const char* value,
                                   const std::vector<std::string>& arguments);

// A candelad on a socket of its own while it exists.
class Daemon {
 public:
  explicit Daemon(const std::vector<std::string>& options = {});
  ~Daemon() { stop(); }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  const std::string& address() const { return address_; }  // "" when it did not start
  void stop(int signal = SIGTERM);

 private:
  pid_t pid_ = -1;
  int output_ = -1;
  std::string address_;
};

}  // namespace candela
