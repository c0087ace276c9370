// Files for tests: temporary folders, whole files in and out, and the test data.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace candela {

// A new folder. The destructor removes it with everything in it.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  std::string path(const std::string& name) const { return root_ + "/" + name; }
  std::vector<std::string> list() const;  // names_in() it

 private:
  std::string root_;
};

// A file in a new folder. By default only its owner may read it.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& bytes, mode_t mode = 0600);
  const std::string& path() const { return path_; }

 private:
  const TemporaryFolder folder_;
  const std::string path_ = folder_.path("file");
};

void write_file(const std::string& path, const std::string& bytes);
std::string read_file(const std::string& path);

// The names in a folder, also hidden ones, sorted.
std::vector<std::string> names_in(const std::string& folder);

// The root of the test data: CANDELA_DATA if it is set, else the folder given to the build. "" if there is
// none.
std::string data_folder();

// The .exr and .hdr files under a folder of the test data, sorted.
std::vector<std::string> data_files(const std::string& folder);

}  // namespace candela
