// Files that appear whole or not at all, and standard output.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace candela {

// A file that is removed with its writer, even if a signal ends the process.
//
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

// Writes a file that appears complete or not at all.

// The file is written beside its destination under a hidden name. commit() waits until it is on the disk and
// renames it over the destination. Without commit() it is removed, and the old file stays as it was. It has
// the permissions of the file that it replaces, or those of a new file under the umask. Used by one thread.
class AtomicFile {
 public:
  // Fails like writable_destination(), or with the path and the system's reason.
  static absl::StatusOr<AtomicFile> create(const std::string& path);

  // The file for standard output. It is in memory until commit() writes it there.
  static absl::StatusOr<AtomicFile> for_stdout();

  AtomicFile(AtomicFile&& other) noexcept
      : path_(std::move(other.path_)),
        target_(std::move(other.target_)),
        temporary_(std::move(other.temporary_)),
        file_(std::move(other.file_)),
        error_(other.error_) {}

  const std::string& path() const { return path_; }

  // Both return false once either has failed; commit() then returns the reason.
  bool write(const void* bytes, size_t count);
  bool seek(uint64_t position);
  bool failed() const { return error_ != 0; }

  // For a program that writes the file in place of write().
  int descriptor() const { return fileno(file_.get()); }

  uint64_t position() const { return static_cast<uint64_t>(std::ftell(file_.get())); }

  // Call this once. If a write, syncing to the disk or renaming failed, returns the system's reason.
  absl::Status commit();

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  AtomicFile(std::string path, std::string target, std::optional<TemporaryPath> temporary, std::FILE* file)
      : path_(std::move(path)), target_(std::move(target)), temporary_(std::move(temporary)), file_(file) {}

  std::string path_;                        // as given
  std::string target_;                      // with links followed
  std::optional<TemporaryPath> temporary_;  // nothing for standard output
  std::unique_ptr<std::FILE, Close> file_;
  int error_ = 0;  // errno of the first failure
};

// The destination of an AtomicFile: the path with the links at its end followed. Fails, with the path in the
// message, for a folder, FIFO, socket or device, for a file or folder without write permission, and for a
// missing folder or link target. The failure's kind is kOutput.
absl::StatusOr<std::string> writable_destination(const std::string& path);

// The error "PATH: cannot write: REASON" for a value of errno, of the kind kOutput.
absl::Status cannot_write(const std::string& path, int error);

// Bytes to standard output, which is mostly a pipe.

inline constexpr char kStdoutName[] = "standard output";

// Writes all of them. Returns 0 or an errno; EPIPE if nobody reads any more.
int write_to_stdout(const void* bytes, size_t count);

// Writes all that the file of this descriptor holds.
int copy_to_stdout(int file);

}  // namespace candela
