#include "client/run/sequence/sequence_files.h"

#include <glob.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/base/usage.h"
#include "client/image/write/atomic_file.h"
#include "server/base/status_macros.h"

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

// Adds the folder's images. Hidden ones are no frames: macOS keeps a file's attributes in ._x.exr.
absl::Status add_folder(const std::string& folder, std::vector<std::string>& files,
                        std::vector<std::string>& hidden) {
  std::error_code failed;
  const size_t had = files.size(), had_hidden = hidden.size();
  for (fs::directory_iterator at(folder, failed), end; !failed && at != end; at.increment(failed)) {
    if (!is_image(at->path()) || at->is_directory(failed)) continue;
    const bool hides = at->path().filename().string().front() == '.';
    (hides ? hidden : files).push_back(at->path().string());
  }
  if (failed) return absl::ErrnoToStatus(failed.value(), absl::StrFormat("%s: cannot read", folder));
  if (files.size() > had) return absl::OkStatus();
  const std::string but =
      hidden.size() > had_hidden ? absl::StrFormat(" but %s", words_of_hidden(hidden)) : std::string();
  return absl::NotFoundError(
      absl::StrFormat("%s: the folder contains no .exr, .hdr or .pfm file%s; "
                      "name another folder, or a pattern such as 'in/*.exr'",
                      folder, but));
}

absl::Status add_files(const std::string& input, std::vector<std::string>& files,
                       std::vector<std::string>& hidden) {
  std::error_code ignored;
  if (fs::is_directory(input, ignored)) return add_folder(input, files, hidden);
  if (fs::exists(input, ignored)) {
    files.push_back(input);
    return absl::OkStatus();
  }
  const absl::StatusOr<std::optional<NamePattern>> pattern = input_pattern(input);
  if (!pattern.ok()) return pattern.status();
  const std::vector<std::string> found = *pattern ? files_by_number(**pattern) : files_by_glob(input);
  files.insert(files.end(), found.begin(), found.end());
  if (!found.empty()) return absl::OkStatus();
  return absl::NotFoundError(absl::StrFormat(
      "%s: no such file; give a folder, files, or a pattern such as 'in/*.exr' or in/%%04d.exr", input));
}

// A number within a text.
struct NumberAt {
  size_t end = 0;  // where it ends; where it was to begin if there is none
  bool below_0 = false;
  absl::string_view digits;  // without zeros before them
};

NumberAt number_at(const std::string& text, size_t at) {
  const bool minus = text[at] == '-' && begins_number(text, at);
  size_t end = at + (minus ? 1 : 0);
  size_t begin = end;
  while (end < text.size() && absl::ascii_isdigit(text[end])) ++end;
  if (end == begin) return {at, false, {}};
  while (begin < end && text[begin] == '0') ++begin;
  return {end, minus && begin < end, absl::string_view(text).substr(begin, end - begin)};
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
    const NumberAt x = number_at(a, i), y = number_at(b, j);
    if (x.end == i || y.end == j) {
      // Any number stands where its first digit would.
      const char c = x.end == i ? a[i] : '0', d = y.end == j ? b[j] : '0';
      if (c != d) return c < d;
      ++i, ++j;
      continue;
    }
    if (x.below_0 != y.below_0) return x.below_0;
    const auto less = [](const NumberAt& n, const NumberAt& m) {
      return n.digits.size() != m.digits.size() ? n.digits.size() < m.digits.size() : n.digits < m.digits;
    };
    if (x.digits != y.digits) return x.below_0 ? less(y, x) : less(x, y);
    i = x.end, j = y.end;
  }
  if ((i == a.size()) != (j == b.size())) return i == a.size();
  return a < b;
}

std::string words_of_hidden(const std::vector<std::string>& hidden) {
  if (hidden.empty()) return "";
  return absl::StrFormat("%d hidden file%s (%s%s)", hidden.size(), hidden.size() == 1 ? "" : "s",
                         hidden.front(), hidden.size() == 1 ? "" : " ...");
}

absl::StatusOr<FoundFiles> find_frames(const std::vector<std::string>& inputs) {
  std::vector<std::string> files, hidden;
  for (const std::string& input : inputs) {
    RETURN_IF_ERROR(add_files(input, files, hidden));
  }
  const auto sorted = [](const std::vector<std::string>& paths) {
    const std::set<std::string> once(paths.begin(), paths.end());
    std::vector<std::string> in_order(once.begin(), once.end());
    std::sort(in_order.begin(), in_order.end(), natural_less);
    return in_order;
  };
  return FoundFiles{sorted(files), sorted(hidden)};
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

std::string OutputNames::path(int64_t number, const std::string& input) const {
  if (pattern_) return pattern_->path(number);
  const std::string stem = input.empty() ? absl::StrFormat("%04d", number) : fs::path(input).stem().string();
  return (fs::path(folder_) / (stem + extension_)).string();
}

}  // namespace candela
