#include "client/image/read/exr_file.h"

#include <OpenEXR/ImfIO.h>

#include <cstdint>
#include <exception>
#include <new>
#include <span>
#include <stdexcept>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"
#include "client/base/failure.h"
#include "client/image/read/exr_header.h"
#include "client/image/read/readers.h"
#include "server/base/status_macros.h"

namespace candela {
namespace {

constexpr size_t kMaxLibraryText = 1000;  // characters of an OpenEXR error that are passed on

// OpenEXR's stream interface for a FileReader. OpenEXR's own stream reads nothing more once it has met the
// file's end, so a chunk beyond it would hide those before.
class FileStream : public Imf::IStream {
 public:
  explicit FileStream(FileReader& file) : Imf::IStream(file.path().c_str()), file_(file) {}
  bool read(char* bytes, int count) override {
    const auto wanted = static_cast<uint64_t>(count);
    if (at_ > file_.size() || wanted > file_.size() - at_ || (file_.position() != at_ && !file_.seek(at_)) ||
        !file_.read(std::as_writable_bytes(std::span(bytes, wanted)))) {
      throw std::runtime_error(kFileEnds);
    }
    at_ += wanted;
    return at_ < file_.size();
  }
  uint64_t tellg() override { return at_; }
  void seekg(uint64_t position) override { at_ = position; }

 private:
  FileReader& file_;
  uint64_t at_ = 0;
};

}  // namespace

absl::Status with_exr_file(FileReader& opened,
                           absl::FunctionRef<absl::Status(Imf::MultiPartInputFile& file)> use, int threads) {
  opened.seek(0);
  RETURN_IF_ERROR(check_exr_header(opened));
  const std::string& path = opened.path();
  try {
    FileStream stream(opened);
    Imf::MultiPartInputFile file(stream, threads);
    return use(file);
  } catch (const std::bad_alloc&) {
    return failure_of(
        FailureKind::kOther,
        absl::ResourceExhaustedError(absl::StrFormat(
            "%s: not enough memory to decode it; give this process more, or scale it down", path)));
  } catch (const std::exception& error) {
    // Removes the file's name, which the library adds and our message has already. The text may quote the
    // file's content.
    const std::string quoted = absl::StrCat(" \"", path, "\"");
    const std::string text =
        absl::StrReplaceAll(error.what(), {{absl::string_view(quoted), ""}, {"\n", " "}});
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: damaged OpenEXR file: %s", path, printable(text, kMaxLibraryText)));
  }
}

}  // namespace candela
