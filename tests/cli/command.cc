#include "tests/cli/command.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <set>
#include <thread>

#include "tests/support/process.h"

namespace candela {
namespace {

using Clock = std::chrono::steady_clock;
#ifdef CANDELA_SANITIZED  // the reference of 10 megapixels takes minutes
constexpr auto kPatience = std::chrono::minutes(10);
#else
constexpr auto kPatience = std::chrono::minutes(2);
#endif

// Reads both streams until they end. False if that takes too long.
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

// The built-in server has the executor that CANDELA_TEST_EXECUTOR names.
std::vector<std::string> with_executor(std::vector<std::string> arguments) {
  const char* executor = std::getenv("CANDELA_TEST_EXECUTOR");
  const auto says = [&arguments](const char* word) { return std::ranges::count(arguments, word) > 0; };
  const bool built_in = !says("--server") && std::getenv("CANDELA_SERVER") == nullptr;
  if (executor == nullptr || arguments.empty() || !built_in || says("--executor")) return arguments;
  const std::set<std::string> rendering = {"render", "contact", "stream", "meter", "view", "environment"};
  if (rendering.contains(arguments.front()))
    arguments.insert(arguments.begin() + 1, {"--executor", executor});
  return arguments;
}

Outcome run(const std::vector<std::string>& arguments, int signal, int ms,
            const std::string& program = CANDELA_PROGRAM) {
  unsetenv("OCIO");  // a machine's own view would change every picture
  Pipe output, error;
  Outcome outcome;
  const pid_t pid = spawn(program, with_executor(arguments), output.ends[1], error.ends[1]);
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

Outcome candela_in_shell(const std::string& before, const std::vector<std::string>& arguments) {
  std::vector<std::string> words{"-c", before + " && exec \"$0\" \"$@\"", CANDELA_PROGRAM};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return run(words, 0, 0, "/bin/sh");
}

Outcome candela_with_ulimit(const std::string& limit, const std::vector<std::string>& arguments) {
  return candela_in_shell("ulimit " + limit, arguments);
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

}  // namespace candela
