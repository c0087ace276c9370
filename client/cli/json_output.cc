#include "client/cli/json_output.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/cli/terminal.h"
#include "client/run/output_files.h"
#include "client/run/sequence.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr char kJsonOption[] = "--json";

bool can_be_written(int descriptor) {
  const int mode = fcntl(descriptor, F_GETFL);
  return mode >= 0 && (mode & O_ACCMODE) != O_RDONLY;
}

bool leads_to(int descriptor, const struct stat& file) {
  struct stat about {};
  return fstat(descriptor, &about) == 0 && about.st_dev == file.st_dev && about.st_ino == file.st_ino;
}

// The files that a word of the command line may name: itself, the value of --NAME=VALUE, or what a pattern
// matches.
std::vector<std::string> files_of_word(const std::string& word) {
  std::vector<std::string> files{word};
  const size_t equals = word.find('=');
  if (absl::StartsWith(word, "--") && equals != std::string::npos) files.push_back(word.substr(equals + 1));
  const absl::StatusOr<FoundFiles> matched = find_frames({files.back()});
  if (matched.ok()) files.insert(files.end(), matched->paths.begin(), matched->paths.end());
  return files;
}

// Whether fail() may write this path although no command has checked it.
bool may_be_replaced(const std::string& name, const std::vector<std::string>& words) {
  std::error_code failed;
  if (name == "-") return true;
  // A folder that is missing will be made, and the name may lead out of it again: missing/../file.
  const std::filesystem::path path = std::filesystem::weakly_canonical(name, failed);
  if (!std::filesystem::is_regular_file(path, failed)) return true;
  if (!holds_json(path)) return false;
  for (size_t i = 0; i < words.size(); ++i) {
    if (words[i] == kJsonOption && i + 1 < words.size()) {
      ++i;
      continue;
    }
    if (absl::StartsWith(words[i], absl::StrCat(kJsonOption, "="))) continue;
    for (const std::string& named : files_of_word(words[i])) {
      if (std::filesystem::equivalent(path, named, failed)) return false;
    }
  }
  return true;
}

}  // namespace

absl::Status JsonOutput::open() {
  absl::Status status = open_path();
  open_ = status.ok();
  return status;
}

absl::Status JsonOutput::open_path() {
  if (path_.empty()) return absl::OkStatus();
  if (path_ == "-") {
    return can_be_written(STDOUT_FILENO) ? absl::OkStatus() : cannot_write("stdout", EBADF);
  }
  struct stat info {};
  const bool exists = stat(path_.c_str(), &info) == 0;
  if (exists && S_ISDIR(info.st_mode)) return cannot_write(path_, EISDIR);
  // Such as /dev/stdout. A new file in the place of this one would lose what else is written there.
  if (exists && leads_to(STDOUT_FILENO, info) && can_be_written(STDOUT_FILENO)) {
    path_ = "-";
    return absl::OkStatus();
  }
  if (exists && S_ISREG(info.st_mode) && leads_to(STDERR_FILENO, info)) {
    return usage_error(absl::StrFormat(
        "%s %s: stderr is written to this file; write the JSON to another file", kJsonOption, path_));
  }
  if (exists && !S_ISREG(info.st_mode)) {
    return access(path_.c_str(), W_OK) == 0 ? absl::OkStatus() : cannot_write(path_, errno);
  }
  RETURN_IF_ERROR(replaces_only_json(kJsonOption, path_));
  RETURN_IF_ERROR(make_folder_of(path_));
  ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::create(path_));
  file_.emplace(std::move(file));
  return absl::OkStatus();
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
  closed_ = true;
  if (file_) return file_->commit();
  return status_;
}

absl::Status JsonOutput::write(const std::string& text) {
  absl::Status status = add(text);
  status.Update(close());
  return status;
}

absl::Status check_stdout(const JsonOutput& json) {
  if (json.to_stdout()) {
    return usage_error(
        absl::StrFormat("%s - and OUT \"-\": images and JSON would be one stream; write the JSON to a file, "
                        "or to /dev/stderr",
                        kJsonOption));
  }
  if (isatty(STDOUT_FILENO) == 1) {
    return usage_error(
        "OUT is \"-\", and standard output is a terminal; send "
        "it to a program or a file, such as | ffmpeg -i - out.mp4");
  }
  return absl::OkStatus();
}

void JsonOutput::fail(const absl::Status& failure, const std::vector<std::string>& words) {
  if (closed_ || path_.empty()) return;
  if (!open_ && (!may_be_replaced(path_, words) || !open().ok())) return;
  (void)write(failure_line(failure));  // the command's own failure is the one that counts
}

}  // namespace candela
