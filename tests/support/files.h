// Files for tests that need no device: a folder that goes away, whole files in and out, the test data.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace candela {

// A new folder, removed with all that is in it.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  std::string path(const std::string& name) const { return root_ + "/" + name; }
  std::vector<std::string> list() const;  // names, hidden ones too, sorted

 private:
  std::string root_;
};

// A file in a folder of its own, readable for its owner alone unless `mode` says otherwise.
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

// The root of the test data (CANDELA_DATA, or where the build was told), "" when there is none.
std::string data_folder();

// The .exr and .hdr files under a folder of the test data, sorted.
std::vector<std::string> data_files(const std::string& folder);

}  // namespace candela
