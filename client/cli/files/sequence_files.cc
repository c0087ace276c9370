#include "client/cli/files/sequence_files.h"

#include <glob.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <filesystem>
#include <set>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/cli/options/usage.h"
#include "client/image/write/atomic_file.h"

namespace candela {
namespace {
namespace fs = std::filesystem;

constexpr int kMostDigits = 12;

bool is_digit(char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); }

// A pattern such as "a%04db", taken apart at the number.
struct Numbered {
  std::string before, after;
  int digits = 0;  // minimum; padded with zeros
};

// Text without % gives "" before and after. A usage error for a % that is not %d, and for a second %d.
absl::StatusOr<Numbered> parse_number_pattern(const std::string& text) {
  const size_t at = text.find('%');
  if (at == std::string::npos) return Numbered{};
  size_t end = at + 1;
  while (end < text.size() && is_digit(text[end])) ++end;
  int digits = 0;
  if (end > at + 1 && !absl::SimpleAtoi(text.substr(at + 1, end - at - 1), &digits)) digits = kMostDigits + 1;
  if (end >= text.size() || text[end] != 'd' || digits > kMostDigits ||
      text.find('%', end) != std::string::npos || text.find('/', end) != std::string::npos) {
    return usage_error(absl::StrFormat(
        "%s: a pattern has one number, %%d or %%04d, in its file name, and no other %%", text));
  }
  return Numbered{text.substr(0, at), text.substr(end + 1), digits};
}

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

std::vector<std::string> files_by_number(const Numbered& pattern) {
  std::vector<std::string> files =
      files_by_glob(escaped_for_glob(pattern.before) + "*" + escaped_for_glob(pattern.after));
  std::erase_if(files, [&](const std::string& file) {
    const size_t length = file.size() - pattern.before.size() - pattern.after.size();
    const std::string number = file.substr(pattern.before.size(), length);
    return length == 0 || length < static_cast<size_t>(pattern.digits) ||
           !std::all_of(number.begin(), number.end(), is_digit);
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
          absl::StrFormat("%s: the folder contains no .exr, .hdr or .pfm file", input));
    }
    return files;
  }
  if (fs::exists(input, ignored)) return std::vector<std::string>{input};
  if (absl::StrContains(input, '%')) {
    const absl::StatusOr<Numbered> pattern = parse_number_pattern(input);
    if (!pattern.ok()) return pattern.status();
    files = files_by_number(*pattern);
  } else {
    files = files_by_glob(input);
  }
  if (!files.empty()) return files;
  return absl::NotFoundError(
      absl::StrFormat("%s: no such file; give a folder, files, or a pattern such as 'frames/*.exr'", input));
}

}  // namespace

bool natural_less(const std::string& a, const std::string& b) {
  size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!is_digit(a[i]) || !is_digit(b[j])) {
      if (a[i] != b[j]) return a[i] < b[j];
      ++i, ++j;
      continue;
    }
    const auto number = [](const std::string& text, size_t& at) {
      while (at < text.size() && text[at] == '0') ++at;
      const size_t begin = at;
      while (at < text.size() && is_digit(text[at])) ++at;
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
  const absl::StatusOr<Numbered> pattern = parse_number_pattern(output);
  if (!pattern.ok()) return pattern.status();
  if (absl::StrContains(output, '%')) {
    names.before_ = pattern->before;
    names.after_ = pattern->after;
    names.digits_ = pattern->digits;
    names.extension_ = fs::path("x" + pattern->after).extension().string();
    return names;
  }
  if (!is_there_as_folder(output) && fs::path(output).has_extension()) {
    return usage_error(
        absl::StrFormat("%s is a single file; give a folder or a pattern such as out/%%04d%s for a sequence",
                        output, fs::path(output).extension().string()));
  }
  names.is_folder_ = true;
  names.before_ = output;
  names.extension_ = extension;
  return names;
}

std::string OutputNames::path(uint64_t number, const std::string& input) const {
  if (!is_folder_) return absl::StrFormat("%s%0*d%s", before_, digits_, number, after_);
  const std::string stem = input.empty() ? absl::StrFormat("%04d", number) : fs::path(input).stem().string();
  return (fs::path(before_) / (stem + extension_)).string();
}

absl::Status OutputNames::make_folder() const {
  const fs::path folder = is_folder_ ? fs::path(before_) : fs::path(before_ + "x").parent_path();
  std::error_code error;
  if (!folder.empty()) fs::create_directories(folder, error);
  return error ? cannot_write(folder.string(), error.value()) : absl::OkStatus();
}

}  // namespace candela
