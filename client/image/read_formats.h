// The image formats that read_image() reads, and how their files are named. Its first bytes say what a file
// is; its name says only whether a folder's file is an image.
#pragma once

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace candela {

// ".png, .jpg or .exr"; "" of none.
std::string one_of(std::vector<std::string> words);

struct ReadFormat {
  const char* name;
  std::vector<absl::string_view> extensions;  // in lower case, with their dots
};

const std::vector<ReadFormat>& read_formats();

// The format that the path's extension says, in any case; null without a known one.
const ReadFormat* read_format_of(const std::string& path);

// The extension of the file's name in lower case, with its dot; "" without one.
std::string extension_of(const std::string& path);

// "OpenEXR, Radiance, PFM, PNG, AVIF, JPEG or TIFF"
std::string read_format_names();
// ".exr, .hdr, .pfm, .phm, .png, .avif, .jpg, .jpeg, .jfif, .tif or .tiff"
std::string read_extensions();

}  // namespace candela
