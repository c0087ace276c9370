// The `candela` command: process setup, dispatch to a subcommand, and exit codes.
#include <fcntl.h>
#include <grpc/support/log.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/command_line.h"
#include "client/cli/commands/commands.h"
#include "client/cli/json_output.h"
#include "client/cli/options/server_options.h"
#include "client/cli/terminal.h"
#include "client/image/write/atomic_file.h"
#include "client/run/embedded_server.h"
#include "client/run/film.h"
#include "client/run/output_files.h"
#include "server/base/process.h"
#include "server/base/status_macros.h"
#include "server/base/words.h"

namespace candela {
namespace {

constexpr rlim_t kLeastOpenFiles = 48;  // a GPU's driver opens two dozen

// Opens stdin, stdout and stderr if the caller closed them. Otherwise an image file could get one of their
// descriptors and our messages with it. They can only be read, so that what is written there is known to be
// lost.
void open_closed_streams() {
  int descriptor = open("/dev/null", O_RDONLY);
  while (descriptor >= 0 && descriptor <= STDERR_FILENO) descriptor = open("/dev/null", O_RDONLY);
  if (descriptor >= 0) close(descriptor);
}

// gRPC ends the process if it cannot open the few descriptors that it starts with. A GPU's driver does not
// say that it needs more.
absl::Status check_open_files() {
  rlimit limit{};
  if (getrlimit(RLIMIT_NOFILE, &limit) != 0 || limit.rlim_cur >= kLeastOpenFiles) return absl::OkStatus();
  limit.rlim_cur = limit.rlim_max;
  if (limit.rlim_cur >= kLeastOpenFiles && setrlimit(RLIMIT_NOFILE, &limit) == 0) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrFormat(
      "ulimit -n allows %d open files and candela needs %d; raise it", limit.rlim_max, kLeastOpenFiles));
}

// The default action stays off until all files are removed: `timeout`, for one, sends its signal twice.
void end_by_signal(int signal) {
  FilmFile::end_encoder();
  TemporaryPath::remove_all();
  std::signal(signal, SIG_DFL);
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, signal);
  pthread_sigmask(SIG_UNBLOCK, &set, nullptr);
  std::raise(signal);
  _exit(128 + signal);  // process 1 of a container has no default actions
}

// Makes the signals that end the command remove its temporary files first.
void clean_up_on_signals() {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGABRT, SIGALRM, SIGUSR1, SIGUSR2, SIGXCPU}) {
    struct sigaction before {};
    sigaction(signal, nullptr, &before);
    if (before.sa_handler == SIG_IGN) continue;
    struct sigaction action {};
    action.sa_handler = end_by_signal;
    sigaction(signal, &action, nullptr);
  }
}

// A thread of a library found no memory or no thread, which no caller can catch.
[[noreturn]] void end_without_resources() {
  absl::Status status;
  try {
    if (const std::exception_ptr error = std::current_exception()) std::rethrow_exception(error);
  } catch (const std::exception& error) {
    status = system_failure(error);
  } catch (...) {
  }
  FilmFile::end_encoder();
  TemporaryPath::remove_all();
  if (!absl::IsResourceExhausted(status)) std::abort();  // a defect
  print_error(status);
  _exit(exit_code(FailureKind::kOther));
}

constexpr const Command* kCommands[] = {
    &kRenderCommand, &kContactCommand, &kStreamCommand, &kMeterCommand, &kViewCommand,  &kEnvironmentCommand,
    &kSampleCommand, &kReportCommand,  &kBenchCommand,  &kInfoCommand,  &kHealthCommand};

// A variable with a typing error would otherwise go unnoticed.
void tell_of_unknown_variables() {
  for (const auto& [name, words] : unknown_variables(EmbeddedServer::daemon_variables())) {
    print_note(absl::StrFormat("nothing reads the variable %s%s", name, words.empty() ? "" : "; " + words));
  }
}

absl::Status run_line(const std::vector<std::string>& words, std::optional<JsonOutput>& json) try {
  const absl::StatusOr<ParsedCommand> asked = parse_command_line(words, kCommands);
  json.emplace(asked.ok() ? asked->json : json_path_in(words));
  if (!asked.ok()) return asked.status();
  RETURN_IF_ERROR(check_open_files());
  if (!asked->quiet) tell_of_unknown_variables();
  absl::Status status = asked->run(*json);
  if (asked->server) status = name_source(status, *asked->server);
  if (!asked->is_probe || status.ok() || is_usage_error(status)) return status;
  return absl::Status(status.code(), status.message());
} catch (const std::exception& error) {
  return system_failure(error);
}

int run(int argc, char** argv) {
  open_closed_streams();
  clean_up_on_signals();
  // Writing to a closed pipe, or beyond the largest file that ulimit -f allows, returns an error instead of
  // ending the process.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  std::set_terminate(end_without_resources);
  // gRPC's log lines repeat what its statuses say.
  if (std::getenv("GRPC_VERBOSITY") == nullptr) gpr_set_log_function([](gpr_log_func_args*) {});
  const std::vector<std::string> words(argv + std::min(argc, 1), argv + argc);
  std::optional<JsonOutput> json;
  const absl::Status status = run_line(words, json);
  if (status.ok()) return 0;
  if (json) json->fail(status, words);
  remove_empty_folders();
  print_error(status);
  return exit_code(kind_of(status));
}

}  // namespace
}  // namespace candela

int main(int argc, char** argv) { candela::end_process(candela::run(argc, argv)); }
