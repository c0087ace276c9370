#include "tests/support/files.h"

#include <sys/stat.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace candela {
namespace fs = std::filesystem;

TemporaryFolder::TemporaryFolder() {
  std::string root = (fs::temp_directory_path() / "candela-test-XXXXXX").string();
  if (mkdtemp(root.data()) == nullptr) std::abort();
  root_ = root;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(root_, ignored);
}

std::vector<std::string> TemporaryFolder::list() const { return names_in(root_); }

TemporaryFile::TemporaryFile(const std::string& bytes, mode_t mode) {
  write_file(path_, bytes);
  if (chmod(path_.c_str(), mode) != 0) std::abort();
}

void write_file(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

std::string read_file(const std::string& path) {
  std::ostringstream bytes;
  bytes << std::ifstream(path, std::ios::binary).rdbuf();
  return bytes.str();
}

std::vector<std::string> names_in(const std::string& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

std::string data_folder() {
  const char* named = std::getenv("CANDELA_DATA");
  const std::string folder = named != nullptr ? named : CANDELA_DATA_DEFAULT;
  return fs::is_directory(folder) ? folder : "";
}

std::vector<std::string> data_files(const std::string& folder) {
  std::vector<std::string> paths;
  for (const auto& entry : fs::recursive_directory_iterator(data_folder() + "/" + folder)) {
    const std::string extension = entry.path().extension();
    if (extension == ".exr" || extension == ".hdr") paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

}  // namespace candela
