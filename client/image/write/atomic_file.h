// A file that appears whole or not at all.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client/image/write/temporary_path.h"

namespace candela {

// Written beside its destination under a hidden name and, once it is on the disk, renamed over it by
// commit(); destroyed without that, it leaves no trace and the old file as it was. It has the permissions of
// the file that it replaces, or else those that the umask leaves. Used by one thread.
class AtomicFile {
 public:
  // Fails as writable_destination does, or naming the path and the system's reason.
  static absl::StatusOr<AtomicFile> create(const std::string& path);

  AtomicFile(AtomicFile&& other) noexcept
      : path_(std::move(other.path_)),
        target_(std::move(other.target_)),
        temporary_(std::move(other.temporary_)),
        file_(std::move(other.file_)),
        error_(other.error_) {}

  const std::string& path() const { return path_; }

  // Each is false once any of them has failed; commit() then gives the reason.
  bool write(const void* bytes, size_t count);
  bool seek(uint64_t position);
  bool failed() const { return error_ != 0; }

  uint64_t position() const { return static_cast<uint64_t>(std::ftell(file_.get())); }

  // To be called once. Fails, naming the system's reason, when any write so far, bringing them to the disk or
  // the renaming did.
  absl::Status commit();

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  AtomicFile(std::string path, std::string target, TemporaryPath temporary, std::FILE* file)
      : path_(std::move(path)), target_(std::move(target)), temporary_(std::move(temporary)), file_(file) {}

  std::string path_;    // as it was given
  std::string target_;  // links followed
  TemporaryPath temporary_;
  std::unique_ptr<std::FILE, Close> file_;
  int error_ = 0;  // errno of the first failure
};

// The path with the links at its end followed: where an AtomicFile goes. Fails, naming the path, for a
// folder, FIFO, socket or device, for a file or folder closed to us and for a folder or link's target that is
// missing.
absl::StatusOr<std::string> writable_destination(const std::string& path);

// "PATH: cannot write: REASON", of errno's value.
absl::Status cannot_write(const std::string& path, int error);

}  // namespace candela
