#include "client/image/read_formats.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace candela {
namespace {

std::string with_or(std::vector<absl::string_view> words) {
  const absl::string_view last = words.back();
  words.pop_back();
  return absl::StrCat(absl::StrJoin(words, ", "), " or ", last);
}

}  // namespace

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
  std::vector<absl::string_view> names;
  for (const ReadFormat& format : read_formats()) names.emplace_back(format.name);
  return with_or(std::move(names));
}

std::string read_extensions() {
  std::vector<absl::string_view> all;
  for (const ReadFormat& format : read_formats()) {
    all.insert(all.end(), format.extensions.begin(), format.extensions.end());
  }
  return with_or(std::move(all));
}

}  // namespace candela
