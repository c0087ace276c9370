#include "client/cli/files/plot.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"

extern char** environ;

namespace candela {
namespace {

// An anonymous file for one of the child's streams. Unlike a pipe it never blocks.
class Stream {
 public:
  Stream() : descriptor_(memfd_create("plot", MFD_CLOEXEC)) {}
  ~Stream() {
    if (descriptor_ >= 0) close(descriptor_);
  }
  Stream(const Stream&) = delete;
  Stream& operator=(const Stream&) = delete;

  int descriptor() const { return descriptor_; }

  bool fill(const std::string& text) {
    const auto size = static_cast<ssize_t>(text.size());
    return write(descriptor_, text.data(), text.size()) == size && lseek(descriptor_, 0, SEEK_SET) == 0;
  }

  std::string contents() {
    std::string text(static_cast<size_t>(std::max<off_t>(0, lseek(descriptor_, 0, SEEK_END))), '\0');
    const ssize_t got = pread(descriptor_, text.data(), text.size(), 0);
    text.resize(static_cast<size_t>(std::max<ssize_t>(0, got)));
    return text;
  }

 private:
  const int descriptor_;
};

struct Outcome {
  int status = 0;  // as waitpid returns it
  std::string out;
  std::string err;

  bool ok() const { return WIFEXITED(status) && WEXITSTATUS(status) == 0; }

  // The child's exit and output, in one line.
  std::string reason() const {
    const std::string end = WIFEXITED(status) ? absl::StrFormat("it ended with code %d", WEXITSTATUS(status))
                                              : absl::StrFormat("it ended by signal %d", WTERMSIG(status));
    std::string said = err;
    absl::RemoveExtraAsciiWhitespace(&said);
    return said.empty() ? end + " and printed nothing" : absl::StrCat(end, ": ", said);
  }
};

absl::Status missing(int error) {
  return absl::FailedPreconditionError(
      absl::StrFormat("gnuplot, which draws the plots, cannot be run (%s); install the package gnuplot-nox",
                      std::string(absl::ErrnoToStatus(error, "").message())));
}

absl::StatusOr<Outcome> run_gnuplot(const std::string& script) {
  Stream in, out, err;
  if (in.descriptor() < 0 || out.descriptor() < 0 || err.descriptor() < 0 || !in.fill(script)) {
    return absl::ErrnoToStatus(errno, "cannot hold a plot in memory");
  }
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, in.descriptor(), STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&actions, out.descriptor(), STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, err.descriptor(), STDERR_FILENO);
  std::string name = "gnuplot", no_settings = "-d", from_stdin = "-";
  char* arguments[] = {name.data(), no_settings.data(), from_stdin.data(), nullptr};
  pid_t child = 0;
  const int error = posix_spawnp(&child, name.c_str(), &actions, nullptr, arguments, environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return missing(error);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
  return Outcome{status, out.contents(), err.contents()};
}

}  // namespace

absl::Status check_gnuplot() {
  const absl::StatusOr<std::string> svg = plot_svg("check", 100, 100, "plot [0:1] x");
  return svg.ok() || absl::IsFailedPrecondition(svg.status())
             ? svg.status()
             : absl::FailedPreconditionError(absl::StrFormat(
                   "%s; plots need the gnuplot of the package gnuplot-nox", svg.status().message()));
}

absl::StatusOr<std::string> plot_svg(const std::string& name, int width, int height,
                                     const std::string& script) {
  const std::string head = absl::StrFormat(
      "set encoding utf8\nset terminal svg size %d,%d dynamic noenhanced font 'sans-serif,13' name '%s'\n",
      width, height, name);
  const absl::StatusOr<Outcome> outcome = run_gnuplot(head + script + "\n");
  if (!outcome.ok()) return outcome.status();
  const size_t begin = outcome->out.find("<svg");
  const size_t end = outcome->out.rfind("</svg>");
  if (!outcome->ok() || begin == std::string::npos || end == std::string::npos) {
    return absl::InternalError(absl::StrFormat("gnuplot did not draw %s: %s", name, outcome->reason()));
  }
  // Ids of the point shapes are the same in every plot; a page holds many.
  return absl::StrReplaceAll(outcome->out.substr(begin, end + 6 - begin),
                             {{"'gpPt", absl::StrCat("'", name, "Pt")},
                              {"'#gpPt", absl::StrCat("'#", name, "Pt")},
                              {"'gpDot'", absl::StrCat("'", name, "Dot'")},
                              {"'#gpDot'", absl::StrCat("'#", name, "Dot'")}});
}

absl::StatusOr<std::string> plot_png(int width, int height, const std::string& script) {
  const std::string head = absl::StrFormat(
      "set encoding utf8\nset terminal pngcairo size %d,%d noenhanced font 'sans-serif,10'\n", width, height);
  const absl::StatusOr<Outcome> outcome = run_gnuplot(head + script + "\n");
  if (!outcome.ok()) return outcome.status();
  if (!outcome->ok() || outcome->out.compare(0, 8, "\x89PNG\r\n\x1a\n") != 0) {
    return absl::InternalError(absl::StrFormat("gnuplot did not draw a PNG: %s", outcome->reason()));
  }
  return outcome->out;
}

std::string quoted_for_plot(const std::string& text) {
  return absl::StrCat("'", absl::StrReplaceAll(text, {{"'", "''"}, {"\n", " "}}), "'");
}

}  // namespace candela
