#include "client/run/output_files.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <tuple>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "client/base/failure.h"
#include "client/image/write/atomic_file.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {
namespace fs = std::filesystem;

// In the order in which they were made. Used by the main thread.
std::vector<fs::path>& made_folders() {
  static std::vector<fs::path> folders;
  return folders;
}

// Device and inode of a file that exists, else its path.
using FileId = std::tuple<dev_t, ino_t, std::string>;

// Nothing for a path that is no regular file and cannot become one.
std::optional<FileId> file_id(const std::string& path) {
  if (path.empty()) return std::nullopt;
  struct stat about {};
  if (path == "-") {
    if (fstat(STDOUT_FILENO, &about) != 0 || !S_ISREG(about.st_mode)) return std::nullopt;
    return FileId{about.st_dev, about.st_ino, ""};
  }
  // Missing folders are made, so "new/../a" will be "a".
  std::error_code failed;
  const fs::path plain = fs::weakly_canonical(fs::absolute(path, failed), failed);
  const std::string whole = failed ? path : plain.string();
  if (stat(path.c_str(), &about) != 0 && stat(whole.c_str(), &about) != 0) return FileId{0, 0, whole};
  if (!S_ISREG(about.st_mode)) return std::nullopt;
  return FileId{about.st_dev, about.st_ino, ""};
}

}  // namespace

std::vector<std::string> files_of(const ServerChoice& server) {
  const ClientSecurity& security = server.security;
  return {security.ca_file, security.cert_file, security.key_file, security.token_file};
}

absl::Status check_outputs_apart(const std::vector<std::string>& inputs,
                                 const std::vector<OutputFile>& outputs) {
  std::map<FileId, std::string> read;
  const auto given =
      std::count_if(inputs.begin(), inputs.end(), [](const auto& path) { return !path.empty(); });
  for (const std::string& input : inputs) {
    if (const std::optional<FileId> id = file_id(input)) read.emplace(*id, input);
  }
  std::map<FileId, const OutputFile*> written;
  for (const OutputFile& output : outputs) {
    const std::optional<FileId> id = file_id(output.path);
    if (!id) continue;
    if (const auto input = read.find(*id); input != read.end()) {
      const std::string which = input->second == output.path ? "" : absl::StrFormat(", %s", input->second);
      return usage_error(absl::StrFormat("%s is %s%s; write %s to another file", output.path,
                                         given == 1 ? "the input" : "one of the inputs", which, output.what));
    }
    const auto [other, fresh] = written.emplace(*id, &output);
    if (!fresh) {
      return usage_error(absl::StrFormat("%s: %s and %s would be one file; write one elsewhere", output.path,
                                         other->second->what, output.what));
    }
  }
  return absl::OkStatus();
}

bool holds_json(const std::string& path) {
  std::ifstream file(path);
  const int first = file.get();
  return file.is_open() && (first == '{' || first == std::ifstream::traits_type::eof());
}

absl::Status replaces_only_json(const char* option, const std::string& path) {
  std::error_code failed;
  const fs::path file = fs::weakly_canonical(path, failed);
  if (!fs::is_regular_file(file, failed) || holds_json(file.string())) return absl::OkStatus();
  return usage_error(absl::StrFormat(
      "%s %s: this file is there and holds no JSON, so it is not replaced; name another file%s", option, path,
      absl::string_view(option) == "--json" ? ", or - for stdout" : ""));
}

bool names_folder(const std::string& path) {
  std::error_code failed;
  return absl::EndsWith(path, "/") || fs::is_directory(path, failed);
}

absl::Status make_folder_of(const std::string& path) {
  if (path.empty() || path == "-") return absl::OkStatus();
  return make_folder(fs::path(path).parent_path().string());
}

absl::Status make_folder(const std::string& folder) {
  std::error_code failed;
  if (folder.empty() || fs::is_directory(folder, failed)) return absl::OkStatus();
  RETURN_IF_ERROR(make_folder_of(folder));
  if (fs::create_directory(folder, failed)) made_folders().push_back(fs::absolute(folder));
  const int error = failed.value();
  if (error != 0) return cannot_write(folder, fs::exists(folder, failed) ? ENOTDIR : error);
  return fs::is_directory(folder, failed) ? absl::OkStatus() : cannot_write(folder, ENOTDIR);
}

void remove_empty_folders() {
  for (; !made_folders().empty(); made_folders().pop_back()) rmdir(made_folders().back().c_str());
}

}  // namespace candela
