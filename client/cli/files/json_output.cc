#include "client/cli/files/json_output.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <utility>

#include "absl/strings/str_format.h"
#include "client/cli/files/output_files.h"
#include "client/cli/files/terminal.h"
#include "client/cli/options/usage.h"

namespace candela {
namespace {

bool can_be_written(int descriptor) {
  const int mode = fcntl(descriptor, F_GETFL);
  return mode >= 0 && (mode & O_ACCMODE) != O_RDONLY;
}

bool leads_to(int descriptor, const struct stat& file) {
  struct stat about {};
  return fstat(descriptor, &about) == 0 && about.st_dev == file.st_dev && about.st_ino == file.st_ino;
}

}  // namespace

absl::StatusOr<JsonOutput> JsonOutput::open(const std::string& path) {
  JsonOutput output(path);
  if (path.empty()) return output;
  if (path == "-") {
    if (!can_be_written(STDOUT_FILENO)) return cannot_write("stdout", EBADF);
    return output;
  }
  struct stat info {};
  const bool exists = stat(path.c_str(), &info) == 0;
  if (exists && S_ISDIR(info.st_mode)) return cannot_write(path, EISDIR);
  // Such as /dev/stdout. A new file in the place of this one would lose what else is written there.
  if (exists && leads_to(STDOUT_FILENO, info) && can_be_written(STDOUT_FILENO)) {
    output.path_ = "-";
    return output;
  }
  if (exists && S_ISREG(info.st_mode) && leads_to(STDERR_FILENO, info)) {
    return usage_error(
        absl::StrFormat("--json %s: stderr is written to this file; write the JSON to another file", path));
  }
  if (exists && !S_ISREG(info.st_mode)) {
    if (access(path.c_str(), W_OK) != 0) return cannot_write(path, errno);
    return output;
  }
  if (absl::Status status = make_folder_of(path); !status.ok()) return status;
  absl::StatusOr<AtomicFile> file = AtomicFile::create(path);
  if (!file.ok()) return file.status();
  output.file_.emplace(*std::move(file));
  return output;
}

absl::Status JsonOutput::add(const std::string& text) {
  if (path_.empty() || !status_.ok()) return status_;
  if (path_ == "-") return status_ = print(text);
  if (file_) {
    file_->write(text.data(), text.size());  // close() checks for failures
    return absl::OkStatus();
  }
  if (special_ == nullptr) special_.reset(std::fopen(path_.c_str(), "we"));
  if (special_ == nullptr) return status_ = cannot_write(path_, errno);
  errno = 0;
  const bool written = std::fwrite(text.data(), 1, text.size(), special_.get()) == text.size() &&
                       std::fflush(special_.get()) == 0;
  if (!written) status_ = cannot_write(path_, errno);
  return status_;
}

absl::Status JsonOutput::close() {
  if (file_) return file_->commit();
  return status_;
}

absl::Status JsonOutput::write(const std::string& text) {
  absl::Status status = add(text);
  status.Update(close());
  return status;
}

}  // namespace candela
