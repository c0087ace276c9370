#include "tests/service/daemon.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "gtest/gtest.h"

extern char** environ;

namespace candela::testing {

Daemon::Daemon(const std::vector<std::string>& arguments, const char* program) {
  // The software driver leaks a little when it is unloaded; service_test looks for leaks of ours.
  setenv("XDG_CACHE_HOME", CANDELA_TEST_CACHE, 1);  // not the user's
  setenv("ASAN_OPTIONS", "detect_leaks=0", 0);
  static int count = 0;
  errors_path_ =
      ::testing::TempDir() + "candelad_" + std::to_string(getpid()) + "_" + std::to_string(count++) + ".log";
  int ends[2];
  EXPECT_EQ(pipe2(ends, O_CLOEXEC), 0);
  output_ = ends[0];
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, errors_path_.c_str(),
                                   O_WRONLY | O_CREAT | O_TRUNC, 0600);
  std::vector<char*> argv{const_cast<char*>(program)};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  EXPECT_EQ(posix_spawn(&pid_, program, &actions, nullptr, argv.data(), environ), 0);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
}

Daemon::~Daemon() {
  if (pid_ > 0) {
    kill(pid_, SIGKILL);
    wait();
  }
  close(output_);
  std::remove(errors_path_.c_str());
}

std::string Daemon::wait_until_listening() {
  const std::string before = "listening on ";
  std::string line;
  for (char c = 0; read(output_, &c, 1) == 1 && c != '\n';) line += c;
  return line.rfind(before, 0) == 0 ? line.substr(before.size()) : "";
}

void Daemon::signal(int number) { kill(pid_, number); }

int Daemon::wait() {
  int status = 0;
  EXPECT_EQ(waitpid(pid_, &status, 0), pid_);
  pid_ = -1;
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

std::string Daemon::errors() const {
  std::ostringstream text;
  text << std::ifstream(errors_path_).rdbuf();
  return text.str();
}

}  // namespace candela::testing
