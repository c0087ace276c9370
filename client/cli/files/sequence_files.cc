#include "client/cli/files/sequence_files.h"

#include <glob.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <filesystem>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/cli/options/usage.h"
#include "client/image/write/atomic_file.h"

namespace candela {
namespace {
namespace fs = std::filesystem;

bool is_image(const fs::path& path) {
  const std::string extension = absl::AsciiStrToLower(path.extension().string());
  return extension == ".exr" || extension == ".hdr" || extension == ".pfm";
}

// False if the path cannot be examined; reading or writing it will then say why.
bool is_there_as_folder(const std::string& path) {
  std::error_code failed;
  return fs::is_directory(path, failed);
}

std::vector<std::string> files_by_glob(const std::string& pattern) {
  std::vector<std::string> files;
  glob_t found{};
  if (glob(pattern.c_str(), GLOB_NOSORT, nullptr, &found) == 0) {
    for (size_t i = 0; i < found.gl_pathc; ++i) files.emplace_back(found.gl_pathv[i]);
  }
  globfree(&found);
  std::erase_if(files, is_there_as_folder);
  return files;
}

std::string escaped_for_glob(const std::string& text) {
  return absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"*", "\\*"}, {"?", "\\?"}, {"[", "\\["}});
}

std::vector<std::string> files_by_number(const NamePattern& pattern) {
  std::vector<std::string> files =
      files_by_glob(escaped_for_glob(pattern.before) + "*" + escaped_for_glob(pattern.after));
  std::erase_if(files, [&](const std::string& file) {
    const size_t around = pattern.before.size() + pattern.after.size();
    return file.size() < around + static_cast<size_t>(pattern.digits) ||
           !number_between(file, pattern.before.size(), pattern.after.size());
  });
  return files;
}

absl::StatusOr<std::vector<std::string>> files_of(const std::string& input) {
  std::error_code ignored;
  std::vector<std::string> files;
  if (fs::is_directory(input, ignored)) {
    for (fs::directory_iterator at(input, ignored), end; !ignored && at != end; at.increment(ignored)) {
      if (is_image(at->path()) && !at->is_directory(ignored)) files.push_back(at->path().string());
    }
    if (ignored) return absl::ErrnoToStatus(ignored.value(), absl::StrFormat("%s: cannot read", input));
    if (files.empty()) {
      return absl::NotFoundError(
          absl::StrFormat("%s: the folder contains no .exr, .hdr or .pfm file; name another folder, or a "
                          "pattern such as 'in/*.exr'",
                          input));
    }
    return files;
  }
  if (fs::exists(input, ignored)) return std::vector<std::string>{input};
  const absl::StatusOr<std::optional<NamePattern>> pattern = input_pattern(input);
  if (!pattern.ok()) return pattern.status();
  files = *pattern ? files_by_number(**pattern) : files_by_glob(input);
  if (!files.empty()) return files;
  return absl::NotFoundError(absl::StrFormat(
      "%s: no such file; give a folder, files, or a pattern such as 'in/*.exr' or in/%%04d.exr", input));
}

}  // namespace

absl::StatusOr<std::optional<NamePattern>> input_pattern(const std::string& input) {
  std::error_code ignored;
  if (fs::exists(input, ignored)) return std::nullopt;
  const std::string name = fs::path(input).filename().string();
  if (!absl::StrContains(name, '%') && name.find_first_of("*?[") != std::string::npos) return std::nullopt;
  return parse_name_pattern(input);
}

bool natural_less(const std::string& a, const std::string& b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!absl::ascii_isdigit(a[i]) || !absl::ascii_isdigit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    const auto number = [](const std::string& text, size_t& at) {
      while (at < text.size() && text[at] == '0') ++at;
      const size_t begin = at;
      while (at < text.size() && absl::ascii_isdigit(text[at])) ++at;
      return text.substr(begin, at - begin);
    };
    const std::string x = number(a, i), y = number(b, j);
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  if ((i == a.size()) != (j == b.size())) return i == a.size();
  return a < b;
}

absl::StatusOr<std::vector<std::string>> find_frames(const std::vector<std::string>& inputs) {
  std::set<std::string> all;
  for (const std::string& input : inputs) {
    const absl::StatusOr<std::vector<std::string>> files = files_of(input);
    if (!files.ok()) return files.status();
    all.insert(files->begin(), files->end());
  }
  std::vector<std::string> sorted(all.begin(), all.end());
  std::sort(sorted.begin(), sorted.end(), natural_less);
  return sorted;
}

absl::StatusOr<OutputNames> OutputNames::parse(const std::string& output, const std::string& extension) {
  OutputNames names;
  const bool is_folder = is_there_as_folder(output) || !fs::path(output).has_extension();
  const absl::StatusOr<std::optional<NamePattern>> pattern = parse_name_pattern(output);
  if (!pattern.ok()) return pattern.status();
  // A folder may have # and @ in its name.
  if (*pattern && (!is_folder || absl::StrContains(fs::path(output).filename().string(), '%'))) {
    names.pattern_ = **pattern;
    names.extension_ = fs::path("x" + names.pattern_->after).extension().string();
    return names;
  }
  if (!is_folder) {
    return usage_error(
        absl::StrFormat("%s is a single file; give a folder or a pattern such as out/%%04d%s for a sequence",
                        output, fs::path(output).extension().string()));
  }
  names.folder_ = output;
  names.extension_ = extension;
  return names;
}

std::string OutputNames::path(uint64_t number, const std::string& input) const {
  if (pattern_) return pattern_->path(number);
  const std::string stem = input.empty() ? absl::StrFormat("%04d", number) : fs::path(input).stem().string();
  return (fs::path(folder_) / (stem + extension_)).string();
}

}  // namespace candela
