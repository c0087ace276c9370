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
#include "client/image/temporary_path.h"

namespace candela {

// Written beside its destination under a hidden name and renamed over it by commit(); destroyed without that,
// it leaves no trace and the old file as it was. Used by one thread.
class AtomicFile {
 public:
  // Fails naming the path and the system's reason; also when a file is there that we may not write.
  static absl::StatusOr<AtomicFile> create(const std::string& path);

  AtomicFile(AtomicFile&& other) noexcept
      : path_(std::move(other.path_)),
        temporary_(std::move(other.temporary_)),
        file_(std::move(other.file_)),
        error_(other.error_) {}

  const std::string& path() const { return path_; }

  // Each is false once any of them has failed; commit() then gives the reason.
  bool write(const void* bytes, size_t count);
  bool seek(uint64_t position);
  bool failed() const { return error_ != 0; }

  uint64_t position() const { return static_cast<uint64_t>(std::ftell(file_.get())); }

  // To be called once. Fails, naming the system's reason, when any write so far or the renaming did.
  absl::Status commit();

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  AtomicFile(std::string path, TemporaryPath temporary, std::FILE* file)
      : path_(std::move(path)), temporary_(std::move(temporary)), file_(file) {}

  std::string path_;
  TemporaryPath temporary_;
  std::unique_ptr<std::FILE, Close> file_;
  int error_ = 0;  // errno of the first failure
};

// "PATH: cannot write: REASON", of errno's value.
absl::Status cannot_write(const std::string& path, int error);

}  // namespace candela
