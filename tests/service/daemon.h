// candelad as a process of its own.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace candela::testing {

// Runs candelad, or another build of it, with `arguments`; ends it on destruction.
class Daemon {
 public:
  explicit Daemon(const std::vector<std::string>& arguments, const char* program = CANDELAD);
  ~Daemon();

  // Waits for the line "listening on ADDRESS" and gives the address; empty when the process ended first.
  std::string wait_until_listening();
  void signal(int number);
  // Waits for its end: its exit status, or -N when signal N ended it.
  int wait();
  // Everything it wrote to stderr so far; all of it after wait().
  std::string errors() const;

 private:
  pid_t pid_ = -1;
  int output_ = -1;
  std::string errors_path_;
};

}  // namespace candela::testing
