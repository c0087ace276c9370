#include "tests/support/daemon.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/process.h"

namespace candela {

namespace {

std::vector<std::string> quiet_on_a_port(const std::vector<std::string>& options) {
  std::vector<std::string> arguments{"--listen", "127.0.0.1:0", "--log-level", "off"};
  arguments.insert(arguments.end(), options.begin(), options.end());
  return arguments;
}

}  // namespace

Daemon::Daemon(const std::vector<std::string>& arguments, const char* program) {
  const Pipe output;
  const int errors = open(folder_.path("stderr").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
  pid_ = spawn(program, arguments, output.ends[1], errors);
  EXPECT_GT(pid_, 0) << program;
  close(errors);
  close(output.ends[1]);
  output_ = output.ends[0];
}

Daemon::~Daemon() {
  if (running()) {
    signal(SIGKILL);
    wait();
  }
  close(output_);
}

std::string Daemon::wait_until_listening() {
  const std::string before = "listening on ";
  std::string line;
  for (char c = 0; read(output_, &c, 1) == 1 && c != '\n';) line += c;
  return line.starts_with(before) ? line.substr(before.size()) : "";
}

void Daemon::signal(int number) { kill(pid_, number); }

int Daemon::wait() {
  int status = 0;
  EXPECT_EQ(waitpid(pid_, &status, 0), pid_);
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

std::string Daemon::errors() const { return read_file(folder_.path("stderr")); }

ListeningDaemon::ListeningDaemon(const std::vector<std::string>& options)
    : Daemon(quiet_on_a_port(options)), address_(wait_until_listening()) {
  EXPECT_NE(address_, "") << errors();
}

void ListeningDaemon::stop(int number) {
  if (!running()) return;
  signal(number);
  wait();
}

}  // namespace candela
