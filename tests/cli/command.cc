#include "tests/cli/command.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <thread>

namespace candela {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kPatience = std::chrono::minutes(2);

struct Pipe {
  Pipe() {
    if (pipe2(ends, O_CLOEXEC) != 0) std::abort();
  }
  int ends[2];
};

// stdin is empty; `error` is the stream's end for stderr, or -1 to share ours.
pid_t spawn(const std::string& program, const std::vector<std::string>& arguments, int output, int error) {
  // Not the user's.
  setenv("XDG_CACHE_HOME", CANDELA_TEST_CACHE, 1);
  // The software driver leaks a little when it is unloaded; service_test looks for leaks of ours.
  setenv("ASAN_OPTIONS", "detect_leaks=0", 0);
  std::vector<char*> argv{const_cast<char*>(program.c_str())};
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  if (error >= 0) posix_spawn_file_actions_adddup2(&actions, error, STDERR_FILENO);
  pid_t pid = -1;
  if (posix_spawn(&pid, program.c_str(), &actions, nullptr, argv.data(), environ) != 0) pid = -1;
  posix_spawn_file_actions_destroy(&actions);
  return pid;
}

// Reads both until they end; false when that takes too long.
bool drain(int output, int error, Outcome& outcome) {
  pollfd streams[] = {{output, POLLIN, 0}, {error, POLLIN, 0}};
  std::string* texts[] = {&outcome.out, &outcome.err};
  const auto deadline = Clock::now() + kPatience;
  while (streams[0].fd >= 0 || streams[1].fd >= 0) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
    if (left.count() <= 0 || poll(streams, 2, static_cast<int>(left.count())) == 0) return false;
    for (int i = 0; i < 2; ++i) {
      if (streams[i].revents == 0) continue;
      char bytes[4096];
      const ssize_t count = read(streams[i].fd, bytes, sizeof bytes);
      if (count > 0) texts[i]->append(bytes, static_cast<size_t>(count));
      if (count <= 0) streams[i].fd = -1;
    }
  }
  return true;
}

Outcome run(const std::vector<std::string>& arguments, int signal, int ms) {
  Pipe output, error;
  Outcome outcome;
  const pid_t pid = spawn(CANDELA_PROGRAM, arguments, output.ends[1], error.ends[1]);
  close(output.ends[1]);
  close(error.ends[1]);
  if (signal != 0 && pid > 0) {
    std::this_thread::sleep_for(std::chrono::milliseconds(ms));
    kill(pid, signal);
  }
  const bool ended = drain(output.ends[0], error.ends[0], outcome);
  close(output.ends[0]);
  close(error.ends[0]);
  if (pid < 0) return outcome;
  if (!ended) {
    kill(pid, SIGKILL);
    ADD_FAILURE() << "candela hangs: " << ::testing::PrintToString(arguments);
  }
  int status = 0;
  rusage usage{};
  if (wait4(pid, &status, 0, &usage) == pid) {
    outcome.code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    outcome.peak_kib = usage.ru_maxrss;
  }
  return outcome;
}

}  // namespace

Outcome candela(const std::vector<std::string>& arguments) { return run(arguments, 0, 0); }

Outcome candela_with_signal(const std::vector<std::string>& arguments, int signal, int ms) {
  return run(arguments, signal, ms);
}

Outcome candela_on_failing_machine(const char* variable, const char* value,
                                   const std::vector<std::string>& arguments) {
  setenv(variable, value, 1);
  setenv("LD_PRELOAD", FAILING_MACHINE, 1);
  Outcome outcome = run(arguments, 0, 0);
  unsetenv("LD_PRELOAD");
  unsetenv(variable);
  return outcome;
}

nlohmann::json candela_json(std::vector<std::string> arguments) {
  arguments.insert(arguments.end(), {"--json", "-"});
  const Outcome outcome = candela(arguments);
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  return nlohmann::json::parse(outcome.out, nullptr, false);
}

Daemon::Daemon(const std::vector<std::string>& options) {
  Pipe output;
  std::vector<std::string> arguments{"--listen", "127.0.0.1:0", "--log-level", "off"};
  arguments.insert(arguments.end(), options.begin(), options.end());
  pid_ = spawn(CANDELAD_PROGRAM, arguments, output.ends[1], -1);
  close(output.ends[1]);
  output_ = output.ends[0];
  std::string line;
  char byte = 0;
  while (read(output_, &byte, 1) == 1 && byte != '\n') line.push_back(byte);
  const std::string prefix = "listening on ";
  if (line.starts_with(prefix)) address_ = line.substr(prefix.size());
}

void Daemon::stop(int signal) {
  if (pid_ > 0) {
    kill(pid_, signal);
    waitpid(pid_, nullptr, 0);
    close(output_);
  }
  pid_ = -1;
}

}  // namespace candela
