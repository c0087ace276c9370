#include "client/image/read_formats.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace candela {

std::string one_of(std::vector<std::string> words) {
  if (words.size() < 2) return absl::StrJoin(words, "");
  const std::string last = std::move(words.back());
  words.pop_back();
  return absl::StrCat(absl::StrJoin(words, ", "), " or ", last);
}

const std::vector<ReadFormat>& read_formats() {
  static const std::vector<ReadFormat> formats = {
      {"OpenEXR", {".exr"}},      {"Radiance", {".hdr"}}, {"PFM", {".pfm", ".phm"}},
      {"PNG", {".png"}},          {"AVIF", {".avif"}},    {"JPEG", {".jpg", ".jpeg", ".jfif"}},
      {"TIFF", {".tif", ".tiff"}}};
  return formats;
}

const ReadFormat* read_format_of(const std::string& path) {
  const std::string extension = extension_of(path);
  for (const ReadFormat& format : read_formats()) {
    if (std::ranges::find(format.extensions, extension) != format.extensions.end()) return &format;
  }
  return nullptr;
}

std::string extension_of(const std::string& path) {
  return absl::AsciiStrToLower(std::filesystem::path(path).extension().string());
}

std::string read_format_names() {
  std::vector<std::string> names;
  for (const ReadFormat& format : read_formats()) names.emplace_back(format.name);
  return one_of(std::move(names));
}

std::string read_extensions() {
  std::vector<std::string> all;
  for (const ReadFormat& format : read_formats()) {
    for (const absl::string_view extension : format.extensions) all.emplace_back(extension);
  }
  return one_of(std::move(all));
}

}  // namespace candela
