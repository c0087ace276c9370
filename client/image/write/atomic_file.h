// Writes a file that appears complete or not at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/write/temporary_path.h"

namespace candela {

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

}  // namespace candela
