// Runs candelad as a separate process.
#pragma once

#include <sys/types.h>

#include <csignal>
#include <string>
#include <vector>

#include "tests/support/files.h"

namespace candela {

// Runs candelad, or another build of it, while it exists. Used by one thread.
class Daemon {
 public:
  explicit Daemon(const std::vector<std::string>& arguments, const char* program = CANDELAD);
  ~Daemon();  // kills the process if it still runs
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  // Waits for the line "listening on ADDRESS" and returns the address. Empty if the process ends first.
  std::string wait_until_listening();
  void signal(int number);
  // Waits for the end of the process. Returns its exit status, or -N if signal N ended it.
  int wait();
  // Its stderr so far; after wait(), all of it.
  std::string errors() const;

 protected:
  bool running() const { return pid_ > 0; }

 private:
  const TemporaryFolder folder_;
  pid_t pid_ = -1;
  int output_ = -1;
};

// A Daemon that listens on a free TCP port and writes no log. It is ready once it is constructed.
class ListeningDaemon : private Daemon {
 public:
  explicit ListeningDaemon(const std::vector<std::string>& options = {});
  ~ListeningDaemon() { stop(); }

  const std::string& address() const { return address_; }  // "" if it did not start
  void stop(int number = SIGTERM);                         // and waits for the end

 private:
  const std::string address_;
};

}  // namespace candela
