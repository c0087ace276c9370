// A file that must not outlive its writer, not even one that a signal ends.
#pragma once

#include <string>

namespace candela {

// Owns the name of a file that exists. Move-only; used by one thread.
class TemporaryPath {
 public:
  explicit TemporaryPath(std::string path);
  TemporaryPath(TemporaryPath&& other) noexcept;
  ~TemporaryPath();  // removes the file, unless it was let go

  const std::string& path() const { return path_; }
  void let_go();  // the file has got another name

  // Removes the files of all that exist in this process. Async-signal-safe: for the handler of a signal that
  // ends the process.
  static void remove_all();

 private:
  std::string path_;  // "" once there is nothing to remove
  int slot_ = -1;     // where remove_all() finds the path; -1 where there was no room for it
};

}  // namespace candela
