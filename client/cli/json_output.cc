#include "client/cli/json_output.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <utility>

#include "client/cli/terminal.h"

namespace candela {
namespace {

bool is_special(const std::string& path) {
  struct stat info {};
  return stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode) && !S_ISDIR(info.st_mode);
}

absl::Status write_special(const std::string& path, const std::string& text) {
  std::FILE* file = std::fopen(path.c_str(), "we");
  if (file == nullptr) return cannot_write(path, errno);
  errno = 0;
  const bool written = std::fwrite(text.data(), 1, text.size(), file) == text.size();
  const bool closed = std::fclose(file) == 0;
  return written && closed ? absl::OkStatus() : cannot_write(path, errno);
}

}  // namespace

absl::StatusOr<JsonOutput> JsonOutput::open(const std::string& path) {
  JsonOutput output(path);
  if (path.empty() || path == "-") return output;
  struct stat info {};
  if (stat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode)) return cannot_write(path, EISDIR);
  if (is_special(path)) {
    if (access(path.c_str(), W_OK) != 0) return cannot_write(path, errno);
    return output;
  }
  absl::StatusOr<AtomicFile> file = AtomicFile::create(path);
  if (!file.ok()) return file.status();
  output.file_.emplace(*std::move(file));
  return output;
}

absl::Status JsonOutput::write(const std::string& text) {
  if (path_.empty()) return absl::OkStatus();
  if (path_ == "-") return print(text);
  if (!file_) return write_special(path_, text);
  file_->write(text.data(), text.size());
  return file_->commit();
}

}  // namespace candela
