// A file that is removed with its writer, even if a signal ends the process.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>

namespace candela {

// Owns the name of a file. Move-only; used by one thread.
class TemporaryPath {
 public:
  // Creates a file with the permissions `mode` less the umask, and sets `descriptor`, open for reading and
  // writing, for the caller to close. Returns nothing and sets errno if it cannot: EEXIST if the name is in
  // use, EMFILE beyond 1024 such files in this process. Does not return once remove_all() was called.
  static std::optional<TemporaryPath> create(std::string path, mode_t mode, int& descriptor);

  TemporaryPath(TemporaryPath&& other) noexcept;
  ~TemporaryPath();  // removes the file unless it was renamed

  // Renames the file to `target`, over an old file, and owns it no longer. Returns false and sets errno if it
  // cannot. Does not return if remove_all() has removed the file.
  bool rename_to(const std::string& target);

  // Removes the files of all TemporaryPaths in this process, which must end next: no other can be created.
  // Waits up to a second for those that other threads are creating. One that takes longer may be left.
  // Async-signal-safe.
  static void remove_all();

 private:
  TemporaryPath(std::string path, int slot);

  std::string path_;
  int slot_;  // where remove_all() finds the path; -1 if there is nothing to remove
};

}  // namespace candela
