// A file that is removed with its writer, even if a signal ends the process.
#pragma once

#include <string>

namespace candela {

// Owns the name of an existing file. Move-only; used by one thread.
class TemporaryPath {
 public:
  explicit TemporaryPath(std::string path);
  TemporaryPath(TemporaryPath&& other) noexcept;
  ~TemporaryPath();  // removes the file unless let_go() was called

  const std::string& path() const { return path_; }
  void let_go();  // the file has another name now

  // Removes the files of all TemporaryPaths in this process. Async-signal-safe, for handlers of signals that
  // end the process.
  static void remove_all();

 private:
  std::string path_;  // "" if there is nothing to remove
  int slot_ = -1;     // where remove_all() finds the path; -1 if there was no free slot
};

}  // namespace candela
