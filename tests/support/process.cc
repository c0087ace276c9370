#include "tests/support/process.h"

#include <fcntl.h>
#include <spawn.h>
#include <unistd.h>

#include <cstdlib>

namespace candela {

Pipe::Pipe() {
  if (pipe2(ends, O_CLOEXEC) != 0) std::abort();
}

pid_t spawn(const std::string& program, const std::vector<std::string>& arguments, int output, int error) {
  setenv("XDG_CACHE_HOME", CANDELA_TEST_CACHE, 1);
  // The software driver leaks a little when it is unloaded. service_test looks for our own leaks.
  setenv("ASAN_OPTIONS", "detect_leaks=0", 0);
  // For candelad, as tests/support/device_fixture.h has it.
  if (const char* executor = std::getenv("CANDELA_TEST_EXECUTOR")) setenv("CANDELA_EXECUTOR", executor, 1);
  std::vector<char*> argv{const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, error, STDERR_FILENO);
  pid_t pid = -1;
  if (posix_spawn(&pid, program.c_str(), &actions, nullptr, argv.data(), environ) != 0) pid = -1;
  posix_spawn_file_actions_destroy(&actions);
  return pid;
}

}  // namespace candela
