// Files for the tests of the command: a folder that goes away, images to render, and what a PNG says of
// itself.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace candela {

// A new folder, removed with all that is in it.
class Folder {
 public:
  Folder();
  ~Folder();
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  std::string path(const std::string& name) const { return root_ + "/" + name; }
  std::vector<std::string> list() const;  // names, hidden ones too, sorted

 private:
  std::string root_;
};

void write_file(const std::string& path, const std::string& bytes);
std::string read_file(const std::string& path);

// What a PNG's header says; all zero when the file is none.
struct PngFacts {
  uint32_t width = 0;
  uint32_t height = 0;
  int bits = 0;
  bool alpha = false;
  double pixel_aspect = 1;  // width / height of a pixel, from pHYs
};
PngFacts png_facts(const std::string& path);

// An OpenEXR file of 31 x 17 halves with highlights; with alpha and pixels twice as wide as high on request.
void write_small_exr(const std::string& path, bool alpha_and_aspect = false);

// The root of the test data (CANDELA_DATA, or where the build was told), "" when there is none.
std::string data_folder();

// The .exr and .hdr files under a folder of the test data, sorted.
std::vector<std::string> data_files(const std::string& folder);

}  // namespace candela
