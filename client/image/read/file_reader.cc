#include "client/image/read/file_reader.h"

#include <sys/stat.h>

#include <algorithm>
#include <cerrno>

#include "absl/strings/str_format.h"

namespace candela {

absl::StatusOr<FileReader> FileReader::open(const std::string& path) {
  struct stat info {};
  // Checked before opening, because opening a pipe would wait for its writer.
  if (stat(path.c_str(), &info) != 0)
    return absl::ErrnoToStatus(errno, absl::StrFormat("%s: cannot read", path));
  if (S_ISDIR(info.st_mode)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: this is a folder; name an image file in it", path));
  }
  if (!S_ISREG(info.st_mode)) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: not a regular file; save the image to one", path));
  }
  std::FILE* file = std::fopen(path.c_str(), "rbe");
  if (file == nullptr) return absl::ErrnoToStatus(errno, absl::StrFormat("%s: cannot read", path));
  setvbuf(file, nullptr, _IOFBF, 1 << 16);
  return FileReader(path, file, static_cast<uint64_t>(info.st_size));
}

absl::StatusOr<FileReader> FileReader::of(std::string name, std::string bytes) {
  if (bytes.empty()) return absl::InvalidArgumentError(absl::StrFormat("%s: the file is empty", name));
  auto held = std::make_unique<std::string>(std::move(bytes));
  std::FILE* file = fmemopen(held->data(), held->size(), "rb");
  if (file == nullptr) return absl::ErrnoToStatus(errno, absl::StrFormat("%s: cannot read", name));
  FileReader reader(std::move(name), file, held->size());
  reader.bytes_ = std::move(held);
  return reader;
}

absl::StatusOr<std::string> FileReader::peek(size_t count) {
  std::string bytes(count, '\0');
  bytes.resize(std::fread(bytes.data(), 1, count, file_.get()));
  if (std::ferror(file_.get()) != 0) {
    return absl::ErrnoToStatus(errno, absl::StrFormat("%s: cannot read", path_));
  }
  std::clearerr(file_.get());
  std::fseek(file_.get(), static_cast<long>(position_), SEEK_SET);
  return bytes;
}

int FileReader::get() {
  const int byte = getc_unlocked(file_.get());
  if (byte >= 0 && position_ < size_) ++position_;
  return byte;
}

bool FileReader::read(std::span<std::byte> out) {
  const size_t count = std::fread(out.data(), 1, out.size(), file_.get());
  position_ = std::min(size_, position_ + count);
  return count == out.size();
}

bool FileReader::skip(uint64_t count) { return count <= remaining() && seek(position_ + count); }

bool FileReader::seek(uint64_t position) {
  if (position > size_) return false;
  position_ = position;
  return std::fseek(file_.get(), static_cast<long>(position_), SEEK_SET) == 0;
}

bool FileReader::read_line(std::string& line, size_t max_length) {
  line.clear();
  for (int byte = get(); byte >= 0; byte = get()) {
    if (byte == '\n') return true;
    if (line.size() == max_length) return false;
    line.push_back(static_cast<char>(byte));
  }
  return false;
}

absl::Status FileReader::truncated(const std::string& what) const {
  return absl::InvalidArgumentError(absl::StrFormat("%s: the file is truncated: %s is missing", path_, what));
}

}  // namespace candela
